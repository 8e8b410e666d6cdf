"""Specifications of the environments of a training run."""

from collections.abc import Mapping
from typing import Any

from kitchen_suite.rollouts.spec import RecordingSpec
from kitchen_suite.training.settings import TrainSettings


def make_spec(
    settings: TrainSettings, task_kwargs: Mapping[str, Any], max_episode_steps: int | None = None
) -> RecordingSpec:
    """Returns the specification of environments of the task, with which `kitchen-play` can play the policy.

    Args:
      settings: of the run.
      task_kwargs: arguments of the environments.
      max_episode_steps: the domain's when omitted.

    Raises:
      TypeError: an argument has the wrong type, or there is no such argument.
      ValueError: an unknown name, or a value that is refused.
    """
    spec = RecordingSpec.make(
        domain_name=settings.domain_name,
        task_name=settings.task_name,
        task_kwargs=task_kwargs,
        policy="zero",
        seed=settings.seed,
        seeding="gymnasium",
        max_episode_steps=max_episode_steps,
    )
    default = spec.env_class.observed.default_type
    if spec.task_kwargs.get("obs_type") not in (None, default):
        raise ValueError(
            f"obs_type {spec.task_kwargs['obs_type']!r} cannot be trained on here: policies take the domain's "
            f"default, {default!r}; leave obs_type out, or learn from pictures as in docs/tutorial.md"
        )
    spec.make_environment().close()
    return spec

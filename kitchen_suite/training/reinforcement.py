"""Training by PPO: the environments that are trained in, and the learners in them."""

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import checks, suite
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.settings import TrainSettings
from kitchen_suite.training.hyperparameters import Hyperparameters, find_recipe
from kitchen_suite.training.imitation.demonstrations import OBSERVATION_OPTIONS, load_to_clone
from kitchen_suite.training.learner import PPOLearner
from kitchen_suite.training.seed_run import Training


def make_spec(
    settings: TrainSettings, task_kwargs: Mapping[str, Any], max_episode_steps: int | None = None
) -> EnvironmentSpec:
    """Returns the specification of environments of the task, with which `kitchen-play` can play the policy.

    Args:
      settings: of the run.
      task_kwargs: arguments of the environments.
      max_episode_steps: the domain's when omitted.
    """
    spec = EnvironmentSpec.make(
        domain_name=settings.domain_name,
        task_name=settings.task_name,
        task_kwargs=task_kwargs,
        max_episode_steps=max_episode_steps,
    )
    default = spec.env_class.obs_types[0]
    if spec.task_kwargs.get("obs_type") not in (None, default):
        raise ValueError(
            f"obs_type {spec.task_kwargs['obs_type']!r} cannot be trained on here: policies take the domain's "
            f"default, {default!r}; leave obs_type out, or learn from pictures as in docs/guide/tutorial.md"
        )
    spec.make_environment().close()
    return spec


class PPOTraining(Training):
    """The environments, hyperparameters and demonstrations of a run by PPO.

    Attributes:
      environments: that are trained in.
    """

    title = "PPO"

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Makes the environments.

        Args:
          settings: of the run.
          spec: of the environments that are evaluated in.
        """
        if settings.schedule.num_steps == 0 and not settings.demonstrations:
            raise ValueError("num_steps 0 is for cloning alone, which needs --demonstrations")
        if settings.num_demonstrations:
            raise ValueError("--num_demonstrations is for the algorithms bc, flow and vqbet; PPO clones all episodes")
        self._settings, self._spec = settings, spec
        self.training_kwargs = self._make_training_kwargs()
        self.config = Hyperparameters.for_domain(
            settings.domain_name, settings.hyperparameters, cloning=bool(settings.demonstrations)
        )
        training = self._make_training_spec()
        self.max_episode_steps = training.max_episode_steps
        options = spec.env_class.flat_options
        self.environments = training.make_vector_env(
            self.config.num_envs, settings.num_threads, AutoresetMode.SAME_STEP, **options
        )
        self._initial_policy, self._demonstrations = self._load_initial_policy(), self._load_demonstrations()

    def make_learner(self, seed: int) -> PPOLearner:
        learner = PPOLearner(self.environments, self.config, seed)
        if self._initial_policy:
            learner.adopt(self._initial_policy)
        return learner

    def prepare(self, learner: PPOLearner) -> None:
        if self._demonstrations:
            with _cloning_bar(self.config.clone_epochs) as report:
                learner.imitate(*self._demonstrations, report)

    def close(self) -> None:
        self.environments.close()

    def _make_training_kwargs(self) -> dict[str, Any]:
        """Returns the arguments of the environments that are trained in, which replace those of the task.

        The domain's are left out where the task's arguments have them.
        """
        settings = self._settings
        domain = suite.find_domain(settings.domain_name)
        own = {} if settings.demonstrations else find_recipe(settings.domain_name).options
        given = {*settings.environment_kwargs, *suite.task_arguments(settings.domain_name, self._spec.task_name)}
        defaults = {name: value for name, value in own.items() if name not in given}
        arguments = json.loads(json.dumps({**defaults, **settings.training_kwargs}))
        if shared := sorted(
            {*OBSERVATION_OPTIONS, *self._spec.env_class.goal_options, *domain.control_options} & arguments.keys()
        ):
            raise ValueError(f"training_kwargs cannot change {shared}, on which the policy depends: use --task_kwargs")
        return arguments

    def _make_training_spec(self) -> EnvironmentSpec:
        """Returns the specification of the environments that are trained in."""
        arguments = {**self._settings.environment_kwargs, **self.training_kwargs}
        steps = arguments.pop("max_episode_steps", None)
        if steps is not None:
            checks.integer(steps, "max_episode_steps", minimum=1)
        return make_spec(self._settings, arguments, steps)

    def _load_initial_policy(self) -> TrainedPolicy | None:
        """Returns the policy to start from, if any; raises as `TrainedPolicy.load`."""
        path = self._settings.initial_policy
        if path is None:
            return None
        if self._settings.demonstrations:
            raise ValueError("--initial_policy and --demonstrations both give a policy to start from: give one of them")
        policy = TrainedPolicy.load(path)
        if (domain := policy.metadata["domain_name"]) != self._settings.domain_name:
            raise ValueError(f"{path} is a policy of the domain {domain}, not of {self._settings.domain_name}")
        return policy

    def _load_demonstrations(self) -> tuple[NDArray, NDArray] | None:
        """Returns the observations and actions to clone, if any; raises as `_load`."""
        if not self._settings.demonstrations:
            return None
        loaded = zip(*map(self._load, self._settings.demonstrations), strict=True)
        observations, actions = map(np.concatenate, loaded)
        return observations, actions

    def _load(self, folder: Path) -> tuple[NDArray, NDArray]:
        """Returns the observations and actions of a recording; raises as `load_to_clone`."""
        observations, actions = load_to_clone(folder, self._spec)
        space, shape = self.environments.single_observation_space, self.environments.single_action_space.shape
        found, expected = (observations.shape[1:], actions.shape[1:]), ((spaces.flatdim(space),), shape)
        if found != expected:
            raise ValueError(f"{folder} holds observations and actions of shapes {found}, but this task has {expected}")
        return observations, actions


@contextlib.contextmanager
def _cloning_bar(epochs: int) -> Iterator[Callable[[float], None]]:
    """Shows a progress bar; yields the function that takes the loss of each epoch."""
    with tqdm(total=epochs, desc="cloning", unit="epoch", disable=None, leave=False) as bar:

        def report(loss: float) -> None:
            bar.set_postfix_str(f"loss {loss:.4f}", refresh=False)
            bar.update()

        yield report

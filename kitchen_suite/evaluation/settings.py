"""Settings of `kitchen-evaluate`."""

import dataclasses
from pathlib import Path
from typing import Any

from kitchen_suite.rollouts.settings import PICTURES_PREFIX, PageSettings, TaskSettings


def _replaceable() -> Any:
    """Returns the field of a setting that replaces the protocol's value."""
    return dataclasses.field(default=None, metadata={"unset": "the protocol's"})


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluateSettings(TaskSettings, PageSettings):
    """Settings of `kitchen-evaluate`; each is the flag of its name.

    Those that are None, and `task_kwargs` that are not given, are the protocol's.
    """

    protocol: str = "default"
    domain_name: str = "kitchen"
    policy: str = "random"
    task_name: str | None = _replaceable()
    control_mode: str | None = _replaceable()
    variations: str | None = _replaceable()
    variation_split: str | None = _replaceable()
    seed: int | None = _replaceable()
    num_episodes: int | None = _replaceable()
    max_episode_steps: int | None = _replaceable()
    num_envs: int = 16
    num_threads: int | None = None
    resume: bool = False
    output: Path | None = None
    json: Path | None = None

    @property
    def observes_pictures(self) -> bool:
        """Whether observations hold pictures, so that playing needs a GL library."""
        return str(self.task_kwargs.get("obs_type")).startswith(PICTURES_PREFIX)

"""Settings of `kitchen-train`."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite.rollouts.settings import TaskSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainSettings(TaskSettings):
    """Settings of `kitchen-train`; each is the flag of its name.

    Steps are control steps over all environments.
    """

    output: Path
    domain_name: str = "open_cabinet"
    training_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    demonstrations: Path | None = None
    num_steps: int = 49_000_000
    eval_interval: int = 500_000
    eval_episodes: int = 100
    target_success: float = 0.99
    patience: int = 8_000_000
    min_progress: float = 0.05
    seed: int = 0
    restarts: int = 3
    num_threads: int | None = None
    resume: bool = False
    video: Path | None = None

"""Settings of `kitchen-train`."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite.rollouts.settings import TaskSettings
from kitchen_suite.training.recipes import find_recipe

# Algorithms by the name of `--algorithm`; all but the first learn from demonstrations alone.
PPO = "ppo"
ALGORITHMS = (PPO, "bc", "flow", "vqbet")

# Of imitation, in every domain.
_IMITATION = {"num_steps": 8_000, "eval_interval": 4_000, "target_success": 1.1, "patience": 0}

# Of domains without `training_settings` of their own.
_DEFAULTS = {"num_steps": 49_000_000, "eval_interval": 500_000, "target_success": 0.99, "patience": 8_000_000}


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainSettings(TaskSettings):
    """Settings of `kitchen-train`; each is the flag of its name.

    Steps are control steps over all environments, and steps of the optimiser in imitation. Those that are None are the
    domain's or the algorithm's, see `schedule`.
    """

    output: Path
    domain_name: str = "open_cabinet"
    algorithm: str = PPO
    training_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    demonstrations: tuple[Path, ...] = ()
    num_demonstrations: tuple[int, ...] = ()
    initial_policy: Path | None = None
    num_steps: int | None = None
    eval_interval: int | None = None
    eval_episodes: int = 100
    target_success: float | None = None
    patience: int | None = None
    min_progress: float = 0.05
    seed: int = 0
    restarts: int = 3
    num_threads: int | None = None
    resume: bool = False
    video: Path | None = None

    @property
    def schedule(self) -> "Schedule":
        """When to evaluate and when to stop, with the domain's values for those that are None.

        Raises:
          ValueError: an unknown domain.
        """
        own = find_recipe(self.domain_name).settings if self.algorithm == PPO else _IMITATION
        defaults: dict[str, Any] = {**_DEFAULTS, **own}
        chosen = {field.name: getattr(self, field.name) for field in dataclasses.fields(Schedule)}
        values: dict[str, Any] = {name: defaults[name] if value is None else value for name, value in chosen.items()}
        return Schedule(**values)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule:
    """When to evaluate the policy of a seed, and when to stop; each is the flag of its name."""

    num_steps: int
    eval_interval: int
    eval_episodes: int
    target_success: float
    patience: int
    min_progress: float

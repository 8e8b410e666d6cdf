"""Metrics of control steps and of episodes, read from the infos of vectorised environments."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.base import SuiteTask

EPISODE_METRICS = ("episode/success", "episode/progress", "episode/length")


def step_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the reward terms `(n,)` of a step; none if the task's reward has no terms.

    Where the step ended an episode and the next one has begun (autoreset mode `SameStep`), they are those of the step,
    not of the reset.
    """
    ended, final_info = infos.get("_final_info", False), infos.get("final_info", infos)
    terms = [name for name in infos if name.startswith("reward/")]
    return {f"step/{name}": np.where(ended, final_info[name], infos[name]) for name in terms}


def episode_metrics(task: SuiteTask, infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the `EPISODE_METRICS` `(n,)` of episodes of a task from their last infos."""
    values = (infos["is_success"], task.progress_in(infos), infos["episode_step"])
    return {name: np.asarray(value, np.float64) for name, value in zip(EPISODE_METRICS, values, strict=True)}

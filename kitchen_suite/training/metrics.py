"""Metrics of control steps and of episodes, read from the infos of vectorised environments."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

EPISODE_METRICS = ("episode/success", "episode/progress", "episode/length")

_COMPLETIONS = "episode_task_completions_mask"


def step_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the reward terms `(n,)` of a step; none if the task's reward has no terms.

    Where the step ended an episode and the next one has begun (autoreset mode `SameStep`), they are those of the step,
    not of the reset.
    """
    ended, final_info = infos.get("_final_info", False), infos.get("final_info", infos)
    terms = [name for name in infos if name.startswith("reward/")]
    return {f"step/{name}": np.where(ended, final_info[name], infos[name]) for name in terms}


def episode_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the `EPISODE_METRICS` `(n,)` of episodes from their last infos.

    Progress is the drawer's opening [m], or the number of completed kitchen tasks.
    """
    progress = infos[_COMPLETIONS].sum(axis=-1) if _COMPLETIONS in infos else infos["drawer_opening"]
    values = (infos["is_success"], progress, infos["episode_step"])
    return {name: np.asarray(value, np.float64) for name, value in zip(EPISODE_METRICS, values, strict=True)}

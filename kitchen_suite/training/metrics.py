"""What curves are drawn of: numbers of steps and of episodes, out of the environments' infos."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_COMPLETIONS = "episode_task_completions_mask"


def step_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Numbers `(n,)` of a step: the terms of the reward, where it has any.

    Where the step ended an episode and the next has begun, they are those of the end.
    """
    ended, last = infos.get("_final_info", False), infos.get("final_info", infos)
    terms = [name for name in infos if name.startswith("reward/")]
    return {f"step/{name}": np.where(ended, last[name], infos[name]) for name in terms}


def episode_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Numbers `(n,)` of episodes at their ends: `episode/success`, `episode/progress` and `episode/length`.

    Progress is the drawer's opening [m], or the number of kitchen tasks completed.
    """
    progress = infos[_COMPLETIONS].sum(axis=-1) if _COMPLETIONS in infos else infos["drawer_opening"]
    results = {"success": infos["is_success"], "progress": progress, "length": infos["episode_step"]}
    return {f"episode/{name}": np.asarray(values, np.float64) for name, values in results.items()}

"""Reward and termination as functions of goals and infos alone, as goal relabelling needs them.

They hold no state, and take goals with any leading axes: dicts of arrays by task, or arrays with the tasks' goals laid
end to end. Infos are one dict, or for a batch a list or array of them. An info tells tasks by name, or by a mask in
configured order below the same key with `_mask` behind it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.kitchen.goals import GoalSet, goal_distances

TO_COMPLETE = "tasks_to_complete"
STEP_COMPLETIONS = "step_task_completions"
EPISODE_COMPLETIONS = "episode_task_completions"

Info = Mapping[str, Any]
Infos = Info | Sequence[Info] | NDArray[np.object_]
Goal = Mapping[str, ArrayLike] | ArrayLike


def flatten(goal: Goal, goals: GoalSet, what: str) -> NDArray[np.float64]:
    """Lays goals end to end: `(..., k)`.

    Raises:
      TypeError: the goals hold no numbers.
      ValueError: a task is missing, or an array has the wrong shape.
    """
    if isinstance(goal, Mapping):
        if missing := [task for task in goals.tasks if task not in goal]:
            raise ValueError(f"{what} lacks {missing}; it must hold {list(goals.tasks)}")
        sizes = {task: part.shape[-1] for task, part in goals.split(goals.desired).items()}
        parts = [_numbers(goal[task], size, f"{what}[{task!r}]") for task, size in sizes.items()]
        if len({part.shape[:-1] for part in parts}) > 1:
            raise ValueError(f"{what} has parts of different leading shapes: {[part.shape for part in parts]}")
        return np.concatenate(parts, axis=-1)
    return _numbers(goal, goals.desired.size, what)


def reward(
    achieved: NDArray[np.float64], desired: NDArray[np.float64], info: Infos, goals: GoalSet, threshold: float
) -> NDArray[np.float64]:
    """Number of tasks `(...)` within their thresholds, among those that may pay.

    Those are what the info names as to be completed or as completed in the step; all tasks where it names none.
    """
    within = goal_distances(achieved, desired, goals.starts) < threshold
    may_pay = _named(info, within.shape, goals.tasks, (TO_COMPLETE, STEP_COMPLETIONS))
    return (within & may_pay(default=True)).sum(axis=-1).astype(np.float64)


def terminated(
    achieved: NDArray[np.float64], desired: NDArray[np.float64], info: Infos, goals: GoalSet, threshold: float
) -> NDArray[np.bool_]:
    """Whether `(...)` all tasks have been completed: by the info, or where it is silent, by the goals."""
    within = goal_distances(achieved, desired, goals.starts) < threshold
    completed = _named(info, within.shape, goals.tasks, (EPISODE_COMPLETIONS,))
    return np.all(completed(default=within), axis=-1)


def broadcast_infos(info: Infos, shape: tuple[int, ...]) -> NDArray[np.object_]:
    """The infos of a batch of some shape; one that is given alone holds for all.

    Raises:
      TypeError: something is no info.
      ValueError: there are more or fewer infos than the batch has goals.
    """
    infos = np.empty(shape, object)
    if isinstance(info, Mapping):
        infos.fill(info)
        return infos
    given = np.asarray(info, object)
    if any(not isinstance(one, Mapping) for one in given.ravel()):
        raise TypeError(f"info must be one dict, or a list of dicts for a batch, got {info!r}")
    if given.shape != shape:
        raise ValueError(f"info must be one dict, or a list of one for each of the goals {shape}, got {given.shape}")
    return given


def _named(
    info: Infos, shape: tuple[int, ...], tasks: Sequence[str], keys: Sequence[str]
) -> Callable[..., NDArray[np.bool_]]:
    """Which tasks each info names below some keys; call the result with what holds where an info has none of them."""
    infos = broadcast_infos(info, shape[:-1])
    silent = np.array([not any(_has(one, key) for key in keys) for one in infos.ravel()], bool)
    named = np.array([np.any([_mask(one, key, tasks) for key in keys], axis=0) for one in infos.ravel()], bool)
    silent, named = silent.reshape(*infos.shape, 1), named.reshape(shape)
    return lambda default: np.where(silent, default, named)


def _has(info: Info, key: str) -> bool:
    return key in info or f"{key}_mask" in info


def _mask(info: Info, key: str, tasks: Sequence[str]) -> NDArray[np.bool_]:
    if key in info:
        return np.array([task in info[key] for task in tasks])
    mask = checks.array_of(info.get(f"{key}_mask", np.zeros(len(tasks), bool)), f"{key}_mask")
    if mask.shape != (len(tasks),):
        raise ValueError(f"{key}_mask of an info must have shape ({len(tasks)},), got {mask.shape}")
    return mask.astype(bool)


def _numbers(value: ArrayLike, size: int, what: str) -> NDArray[np.float64]:
    array = checks.array_of(value, what)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{what} must hold numbers, got {value!r}")
    if array.ndim == 0 or array.shape[-1] != size:
        raise ValueError(f"{what} must have shape (..., {size}), got {array.shape}")
    return array.astype(np.float64, copy=False)

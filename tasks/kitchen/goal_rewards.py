"""Reward and termination as functions of goals and infos alone, as goal relabelling needs them.

The functions hold no state. Goals may have any leading axes; they are dicts of arrays by task, or arrays with the goals
of all tasks concatenated. Infos are one dict, or a list or array of dicts for a batch. An info lists tasks by name
under a key such as `tasks_to_complete`, or has a mask in configured order under `tasks_to_complete_mask`.
"""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.kitchen.mdp import ATTEMPTED, REWARD_STATE, KitchenMDP
from kitchen_suite.tasks.kitchen.shaping import Shaping, task_shares
from kitchen_suite.tasks.orders import REQUESTED, counted_in_order
from kitchen_suite.tasks.rewards import GOAL_TERMS, CompletionStep, Shares, SharesStep
from kitchen_suite.tasks.terms import total
from kitchen_suite.types import Array

TO_COMPLETE = "tasks_to_complete"
STEP_COMPLETIONS = "step_task_completions"
EPISODE_COMPLETIONS = "episode_task_completions"

Info = Mapping[str, Any]
Infos = Info | Sequence[Info] | NDArray[np.object_]
GoalArrays = Mapping[str, ArrayLike] | ArrayLike


def flatten(goal: GoalArrays, goals: GoalSet, name: str) -> Array:
    """Returns goals of all tasks concatenated in configured order: `(..., k)`; `name` is for messages."""
    if isinstance(goal, Mapping):
        if missing := [task for task in goals.tasks if task not in goal]:
            raise ValueError(f"{name} lacks {missing}; it must hold {list(goals.tasks)}")
        sizes = {task: part.shape[-1] for task, part in goals.split(goals.desired).items()}
        parts = [_numbers(goal[task], size, f"{name}[{task!r}]") for task, size in sizes.items()]
        if len({part.shape[:-1] for part in parts}) > 1:
            raise ValueError(f"{name} has parts of different leading shapes: {[part.shape for part in parts]}")
        return np.concatenate(parts, axis=-1)
    return _numbers(goal, goals.desired.size, name)


def reward(achieved: Array, desired: Array, info: Infos, mdp: KitchenMDP) -> Array:
    """Returns the reward `(...)` of a step.

    With the sparse reward, a task is rewarded if the info lists it as still to complete or as completed in the step. An
    info without these lists and masks rewards every task. A dense reward needs its state, which infos of `step` have
    under `reward_state/...`. Terms that do not follow the goals, such as a user's own, are read under `reward/...`.
    """
    infos = _broadcast(info, np.broadcast_shapes(achieved.shape, desired.shape)[:-1])
    requested = _requested(infos, mdp, ATTEMPTED if mdp.ordering.in_turn else REQUESTED)
    if mdp.is_dense:
        shaping = _shaping(infos, mdp.goals)
        shares = task_shares(shaping, success=mdp.success, achieved=achieved, desired=desired, mask=requested)
        step: CompletionStep | SharesStep = RelabelledShares(shares)
    else:
        rewarded = _listed(infos, mdp.goals.tasks, (TO_COMPLETE, STEP_COMPLETIONS), elsewhere=True)
        within = _within(achieved, desired, mdp) & rewarded
        if mdp.ordering.in_order:
            within = counted_in_order(within, ~rewarded)
        step = RelabelledCompletions(within & requested)
    terms = {
        name: term(step) if term in GOAL_TERMS else _part(infos, f"reward/{name}") for name, term in mdp.rewards.items()
    }
    return total(terms)


class RelabelledCompletions(NamedTuple):
    """A `CompletionStep` for goals other than its episode's."""

    completions: NDArray[np.bool_]


class RelabelledShares(NamedTuple):
    """A `SharesStep` for goals other than its episode's."""

    shares: Shares


def terminated(achieved: Array, desired: Array, info: Infos, mdp: KitchenMDP) -> NDArray[np.bool_]:
    """Returns whether `(...)` all tasks have been completed: by the info if it says so, else by the goals."""
    infos = _broadcast(info, np.broadcast_shapes(achieved.shape, desired.shape)[:-1])
    within = _within(achieved, desired, mdp)
    done = _listed(infos, mdp.goals.tasks, (EPISODE_COMPLETIONS,), elsewhere=within)
    requested = _requested(infos, mdp, REQUESTED)
    return np.all(done | ~requested, axis=-1)


def _requested(infos: NDArray[np.object_], mdp: KitchenMDP, key: str) -> NDArray[np.bool_]:
    """Returns which tasks `(..., n)` infos list under a key; all where one does not, and without draws."""
    if mdp.ordering.draw is None:
        return np.full((*infos.shape, len(mdp.goals.tasks)), True)
    return _listed(infos, mdp.goals.tasks, (key,), elsewhere=True)


def _within(achieved: Array, desired: Array, mdp: KitchenMDP) -> NDArray[np.bool_]:
    """Returns whether `(..., n)` each task is complete; infinitely far goals are not."""
    with np.errstate(over="ignore"):
        return mdp.success.within(achieved, desired)


def _shaping(infos: NDArray[np.object_], goals: GoalSet) -> Shaping:
    example = Shaping.start(goals.desired, np.zeros(len(goals.tasks)), goals)
    widths = {name: part.size for name, part in example._asdict().items()}
    parts: dict[str, Any] = {name: _part(infos, f"{REWARD_STATE}/{name}", width) for name, width in widths.items()}
    return Shaping(**{**parts, "previously_completed": parts["previously_completed"] > 0})


def _part(infos: NDArray[np.object_], key: str, width: int | None = None) -> Array:
    """Returns what infos `(...)` have under a key, `(..., width)` or, without a width, `(...)`."""
    values = []
    for info in infos.ravel():
        if key not in info:
            raise ValueError(f"the reward needs {key!r} of the step's infos, got {sorted(info)}")
        values.append(info[key])
    size = width or 1
    shape = infos.shape if width is None else (*infos.shape, width)
    # All infos at once, which takes a quarter of the time.
    with contextlib.suppress(ValueError), np.errstate(over="ignore"):
        together = checks.array_of(values, key)
        fits = together.ndim <= 2 and together.size == infos.size * size
        if fits and together.dtype.kind in "bfiu":
            numbers = together.astype(np.float64).reshape(shape)
            if np.isfinite(numbers).all():
                return numbers
    # One by one: numbers beside vectors of one element, or an error that shows the info at fault.
    return np.array([_vector(value, size, key) for value in values]).reshape(shape)


def _vector(value: ArrayLike, size: int, key: str) -> Array:
    """Returns what one info has under a key as a float64 vector; a number counts as a vector of one element."""
    array = np.atleast_1d(checks.array_of(value, key))
    return checks.vector(array.astype(np.float64) if array.dtype == bool else array, size, key)


def episode_steps(info: Infos, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Returns the `episode_step` of the infos of a batch; 0 where an info has none."""
    return np.array([one.get("episode_step", 0) for one in _broadcast(info, shape).ravel()]).reshape(shape)


def steps_since_completion(info: Infos, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Returns the steps since the last `completion_steps` of the infos of a batch, or since the reset."""
    last = [max(0, *np.ravel(one.get("completion_steps", 0))) for one in _broadcast(info, shape).ravel()]
    return episode_steps(info, shape) - np.array(last).reshape(shape)


def _broadcast(info: Infos, shape: tuple[int, ...]) -> NDArray[np.object_]:
    """Returns an array of infos of the batch's shape; a single info holds for the whole batch."""
    infos = np.empty(shape, object)
    if isinstance(info, Mapping):
        infos.fill(info)
        return infos
    given = np.asarray(info, object)
    if any(not isinstance(one, Mapping) for one in given.ravel()):
        raise TypeError(f"info must be one dict, or a list of dicts for a batch, got {checks.shown(info)}")
    if given.shape != shape:
        raise ValueError(f"info must be one dict, or a list of one for each of the goals {shape}, got {given.shape}")
    return given


def _listed(
    infos: NDArray[np.object_], tasks: Sequence[str], keys: Sequence[str], *, elsewhere: NDArray[np.bool_] | bool
) -> NDArray[np.bool_]:
    """Returns which tasks `(..., n)` infos `(...)` list under any of the keys; `elsewhere` where an info has no key."""
    unlisted = np.zeros(len(tasks), bool)
    listed = np.zeros((*infos.shape, len(tasks)), bool)
    has_key = np.zeros((*infos.shape, 1), bool)
    for key in keys:
        masks = [_mask(info, key, tasks) for info in infos.ravel()]
        has_key |= np.array([mask is not None for mask in masks], bool).reshape(has_key.shape)
        listed |= np.array([unlisted if mask is None else mask for mask in masks], bool).reshape(listed.shape)
    return np.where(has_key, listed, elsewhere)


def _mask(info: Info, key: str, tasks: Sequence[str]) -> ArrayLike | None:
    """Returns which tasks `(n,)` one info lists under a key, by name or by mask; None if it has neither."""
    if key in info:
        return [task in info[key] for task in tasks]
    if f"{key}_mask" not in info:
        return None
    mask = checks.array_of(info[f"{key}_mask"], f"{key}_mask")
    if mask.shape != (len(tasks),):
        raise ValueError(f"{key}_mask of an info must have shape ({len(tasks)},), got {mask.shape}")
    return mask


def _numbers(value: ArrayLike, size: int, name: str) -> Array:
    """Returns `value` as a float64 array `(..., size)`."""
    array = checks.array_of(value, name)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} must hold numbers, got {checks.shown(value)}")
    if array.ndim == 0 or array.shape[-1] != size:
        raise ValueError(f"{name} must have shape (..., {size}), got {array.shape}")
    return array.astype(np.float64, copy=False)

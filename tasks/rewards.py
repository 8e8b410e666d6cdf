"""Rewards for tasks that are completed one by one, on arrays of shape `(..., n)`.

`sparse` is 1 for each task completed in a step.

`dense` and `dense_gain` follow a potential of each task, in [0, 1]: 1/4 of the hand's approach to the handle, and 3/4
of the joints' progress towards the goal; 1 once the task has been completed. Both shares are relative to the distance
at the reset. The approach is the nearest so far: the hand must leave the handles of other tasks for that of the one
under way, which would cost otherwise. The progress is the present one, so that a door that falls shut costs. Linear
shares lead to the handle and to the goal from any distance. At the threshold of a task the potential is below 1, so
that completion pays more than waiting before it.

`dense` is the potential after each step, `dense_gain` how far it exceeds its greatest value before.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.terms import RewardTerm
from kitchen_suite.types import Array

# Least initial distance [rad, m] that shares are relative to: a hand or an object that starts near has come far.
_LEAST_DISTANCE = 0.1

_APPROACH_WEIGHT = 0.25  # Weight of the approach in the potential of a task.
_PROGRESS_WEIGHT = 0.75  # Weight of the progress in the potential of a task.


class Shares(NamedTuple):
    """How far each task `(..., n)` has come, before and after a step.

    Attributes:
      approach: greatest share of the way to the handle that the hand has covered, in [0, 1].
      previous_approach: the same before the step.
      progress: share of the way to the goal that the joints have covered, in [0, 1].
      previous_progress: greatest such share before the step; where `is_relabelled`, the share just before it.
      is_relabelled: whether the goal is another than the episode's.
      completed: whether the task has been completed.
      previously_completed: the same before the step.
    """

    approach: Array
    previous_approach: Array
    progress: Array
    previous_progress: Array
    is_relabelled: NDArray[np.bool_]
    completed: NDArray[np.bool_]
    previously_completed: NDArray[np.bool_]

    @property
    def remains(self) -> Array:
        """`(..., n)`, 0 for completed tasks, 1 for others."""
        return np.where(self.completed, 0.0, 1.0)


def covered(distances: Array, initial: Array) -> Array:
    """Returns the share in [0, 1] of initial distances that has been covered; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.fmax(1.0 - distances / np.maximum(initial, _LEAST_DISTANCE), 0.0)


class CompletionStep(Protocol):
    """A control step, as far as terms of the sparse reward read it."""

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., n)`, tasks that the step completed."""


class SharesStep(Protocol):
    """A control step, as far as terms of the dense rewards read it."""

    @property
    def shares(self) -> Shares:
        """How far each task has come, before and after the step."""


def _summed(by_task: Array) -> Array:
    """Returns the sums `(...)` over the tasks of values `(..., n)`."""
    # In C order, a row has the same sum alone and among many.
    return np.add.reduce(np.ascontiguousarray(by_task), axis=-1)


def completions(step: CompletionStep) -> Array:
    """The number of tasks completed in the step."""
    return np.add.reduce(step.completions, axis=-1, dtype=np.float64)


def approach(step: SharesStep) -> Array:
    """The part of the approach in the potential after the step."""
    return _summed(_APPROACH_WEIGHT * step.shares.approach * step.shares.remains)


def progress(step: SharesStep) -> Array:
    """The part of the progress in the potential after the step."""
    return _summed(_PROGRESS_WEIGHT * step.shares.progress * step.shares.remains)


def completed(step: SharesStep) -> Array:
    """The number of tasks that have been completed."""
    return _summed(1.0 - step.shares.remains)


def approach_gain(step: SharesStep) -> Array:
    """The gain of the approach over its greatest value before."""
    shares = step.shares
    return _summed(_APPROACH_WEIGHT * (shares.approach - shares.previous_approach) * shares.remains)


def progress_gain(step: SharesStep) -> Array:
    """The gain of the progress over its greatest value before.

    For a goal other than the episode's, as hindsight relabelling has them, the greatest progress so far is unknown. The
    change of the progress, which may be negative, stands for the gain then.
    """
    shares = step.shares
    change = shares.progress - shares.previous_progress
    gain = np.where(shares.is_relabelled, change, np.maximum(change, 0.0))
    return _summed(_PROGRESS_WEIGHT * gain * shares.remains)


def completion_gain(step: SharesStep) -> Array:
    """The rest of the potential up to its greatest value, 1, for each task that the step completes."""
    shares = step.shares
    paid = _APPROACH_WEIGHT * shares.previous_approach + _PROGRESS_WEIGHT * shares.previous_progress
    return _summed(np.where(shares.completed & ~shares.previously_completed, 1.0 - paid, 0.0))


REWARDS: Mapping[str, Mapping[str, RewardTerm]] = MappingProxyType(
    {
        "sparse": MappingProxyType({"completion": completions}),
        "dense": MappingProxyType({"approach": approach, "progress": progress, "completion": completed}),
        "dense_gain": MappingProxyType(
            {"approach": approach_gain, "progress": progress_gain, "completion": completion_gain}
        ),
    }
)
"""The terms of each reward, by the names of reward and term."""

# Rewards that follow how far the tasks have come, by the `shares` of a step.
DENSE = REWARDS.keys() - {"sparse"}

# Names of the terms of the sparse reward, which follow from the completions: neither infos nor saved states have them.
SPARSE_TERMS = REWARDS["sparse"].keys()

GOAL_TERMS = frozenset(term for terms in REWARDS.values() for term in terms.values())
"""The terms of all these rewards, which read only `completions` or `shares` of a step, so that they can be computed for
other goals. Infos have the values of all other terms."""


# Rewards that pay for completed tasks in every later step: their episodes go on by default.
CONTINUING = frozenset({"dense"})

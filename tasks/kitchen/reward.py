"""The kitchen's rewards, on arrays of shape `(..., n)`; `compute_reward` of the Gymnasium environment calls them, too.

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
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.assets import Array
from kitchen_suite.tasks.goals import GoalSet, Success
from kitchen_suite.tasks.terms import RewardTerm

# Least initial distance [rad, m] that shares are relative to: a hand or an object that starts near has come far.
_LEAST_DISTANCE = 0.1

_APPROACH_WEIGHT = 0.25  # Weight of the approach in the potential of a task.
_PROGRESS_WEIGHT = 0.75  # Weight of the progress in the potential of a task.


class Shaping(NamedTuple):
    """State of a dense reward: positions and shares on which it depends beside the achieved goals of a step.

    Attributes:
      initial_achieved: `(..., k)`, achieved goals at the reset [rad, m, quaternion].
      initial_hand_distances: `(..., n)`, distance of the hand from each task's handle at the reset [m].
      hand_distances: `(..., n)`, these distances after the step [m].
      previous_achieved: `(..., k)`, achieved goals before the step.
      best_approach: `(..., n)`, greatest share of the way to the handle covered before the step.
      best_progress: `(..., n)`, greatest share of the way to the goal covered before the step.
      previously_completed: `(..., n)`, whether each task was completed before the step.
    """

    initial_achieved: Array
    initial_hand_distances: Array
    hand_distances: Array
    previous_achieved: Array
    best_approach: Array
    best_progress: Array
    previously_completed: NDArray[np.bool_]

    @classmethod
    def start(cls, achieved: Array, hand_distances: Array, goals: GoalSet) -> Self:
        """Returns the state at a reset."""
        distances = goals.distances(achieved)
        return cls(
            initial_achieved=achieved,
            initial_hand_distances=hand_distances,
            hand_distances=hand_distances,
            previous_achieved=achieved,
            best_approach=covered(hand_distances, hand_distances),
            best_progress=covered(distances, distances),
            previously_completed=np.zeros(distances.shape, bool),
        )

    def restarted(self, mask: NDArray[np.bool_], achieved: Array, goals: GoalSet) -> Self:
        """Returns the state in which, where `mask` `(...)`, the last step counts as a reset.

        Args:
          mask: which episodes.
          achieved: `(..., k)`, achieved goals after that step.
          goals: the tasks.
        """
        restart = self.start(achieved, self.hand_distances, goals)
        return type(self)(*(np.where(mask[..., np.newaxis], new, old) for new, old in zip(restart, self, strict=True)))

    def after(self, achieved: Array, completed: NDArray[np.bool_], hand_distances: Array, goals: GoalSet) -> Self:
        """Returns the state after one more step.

        Args:
          achieved: `(..., k)`, achieved goals before the step.
          completed: `(..., n)`, whether each task was completed before the step.
          hand_distances: `(..., n)`, after it [m].
          goals: the tasks.
        """
        progress = covered(goals.distances(achieved), goals.distances(self.initial_achieved))
        return self._replace(
            hand_distances=hand_distances,
            previous_achieved=achieved,
            best_approach=self.approach,
            best_progress=np.maximum(self.best_progress, progress),
            previously_completed=completed,
        )

    @property
    def approach(self) -> Array:
        """`(..., n)`, greatest share of the way to each task's handle covered up to now."""
        return np.maximum(self.best_approach, covered(self.hand_distances, self.initial_hand_distances))


class Shares(NamedTuple):
    """How far each task `(..., n)` has come, before and after a step.

    Attributes:
      approach: greatest share of the way to the handle that the hand has covered, in [0, 1].
      previous_approach: the same before the step.
      progress: share of the way to the goal that the joints have covered, in [0, 1].
      previous_progress: greatest such share before the step; for another goal than the episode's, the last one.
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


def task_shares(
    shaping: Shaping, *, success: Success, achieved: Array, desired: Array, mask: NDArray[np.bool_] | None = None
) -> Shares:
    """Returns how far each task has come; those outside `mask` have not come anywhere.

    Args:
      shaping: state of the reward after the step.
      success: decides which tasks are complete.
      achieved: `(..., k)`, achieved goals after the step.
      desired: `(..., k)` or `(k,)`, goals that may be others than the episode's.
      mask: `(..., n)`, the tasks that pay; all when omitted.
    """
    goals, before = success.goals, shaping.previous_achieved
    with np.errstate(over="ignore"):
        initial, distances, previous = (
            goals.distances(each, desired) for each in (shaping.initial_achieved, achieved, before)
        )
        within_before, within = success.within(before, desired), success.within(achieved, desired)
    is_relabelled = np.logical_or.reduceat(desired != goals.desired, goals.starts, axis=-1)
    # Of another goal, only the last step before is known.
    previously_completed = np.where(is_relabelled, within_before, shaping.previously_completed)
    shares = Shares(
        approach=shaping.approach,
        previous_approach=shaping.best_approach,
        progress=covered(distances, initial),
        previous_progress=np.where(is_relabelled, covered(previous, initial), shaping.best_progress),
        is_relabelled=is_relabelled,
        completed=previously_completed | within,
        previously_completed=previously_completed,
    )
    if mask is None:
        return shares
    return Shares(*(np.where(mask, part, np.zeros((), part.dtype)) for part in shares))


def covered(distances: Array, initial: Array) -> Array:
    """Returns the share in [0, 1] of initial distances that has been covered; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.fmax(1.0 - distances / np.maximum(initial, _LEAST_DISTANCE), 0.0)


# The terms are functions of a control step: a `KitchenTransition`, or a `goal_rewards.RelabelledStep`.


def _summed(by_task: Array) -> Array:
    """Returns the sums `(...)` over the tasks of values `(..., n)`."""
    # In C order, a row has the same sum alone and among many.
    return np.add.reduce(np.ascontiguousarray(by_task), axis=-1)


def completions(step: Any) -> Array:
    """The number of tasks completed in the step."""
    return np.add.reduce(step.completions, axis=-1, dtype=np.float64)


def approach(step: Any) -> Array:
    """The part of the approach in the potential after the step."""
    return _summed(_APPROACH_WEIGHT * step.shares.approach * step.shares.remains)


def progress(step: Any) -> Array:
    """The part of the progress in the potential after the step."""
    return _summed(_PROGRESS_WEIGHT * step.shares.progress * step.shares.remains)


def completed(step: Any) -> Array:
    """The number of tasks that have been completed."""
    return _summed(1.0 - step.shares.remains)


def approach_gain(step: Any) -> Array:
    """The gain of the approach over its greatest value before."""
    shares = step.shares
    return _summed(_APPROACH_WEIGHT * (shares.approach - shares.previous_approach) * shares.remains)


def progress_gain(step: Any) -> Array:
    """The gain of the progress over its greatest value before.

    For a goal other than the episode's, as hindsight relabelling has them, the greatest progress so far is unknown. The
    change of the progress, which may be negative, stands for the gain then.
    """
    shares = step.shares
    change = shares.progress - shares.previous_progress
    gain = np.where(shares.is_relabelled, change, np.maximum(change, 0.0))
    return _summed(_PROGRESS_WEIGHT * gain * shares.remains)


def completion_gain(step: Any) -> Array:
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

GOAL_TERMS = frozenset({completions, approach, progress, completed, approach_gain, progress_gain, completion_gain})
"""Terms that read only `completions` or, of a dense reward, `shares` of a step, so that they can be computed for other
goals. Infos have the values of all other terms."""

# Rewards that pay for completed tasks in every later step: their episodes go on by default.
CONTINUING = frozenset({"dense"})

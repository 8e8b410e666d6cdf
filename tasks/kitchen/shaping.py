"""The state of the kitchen's dense rewards, and how far each task has come."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import GoalSet, Success
from kitchen_suite.tasks.rewards import Shares, covered
from kitchen_suite.types import Array


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


def task_shares(
    shaping: Shaping, *, success: Success, achieved: Array, desired: Array, mask: NDArray[np.bool_]
) -> Shares:
    """Returns how far each task has come; those outside `mask` have not come anywhere.

    Args:
      shaping: state of the reward after the step.
      success: decides which tasks are complete.
      achieved: `(..., k)`, achieved goals after the step.
      desired: `(..., k)` or `(k,)`, goals that may be others than the episode's.
      mask: `(..., n)`, the tasks that pay.
    """
    goals, before = success.goals, shaping.previous_achieved
    with np.errstate(over="ignore"):
        initial, distances, previous = (
            goals.distances(each, desired) for each in (shaping.initial_achieved, achieved, before)
        )
        within_before, within = success.within(before, desired), success.within(achieved, desired)
    is_relabelled = np.logical_or.reduceat(desired != goals.desired, goals.first_elements, axis=-1)
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
    return Shares(*(np.where(mask, part, np.zeros((), part.dtype)) for part in shares))

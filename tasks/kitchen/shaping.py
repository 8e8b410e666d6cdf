"""The state of the kitchen's dense rewards in an episode, on arrays of shape `(..., n)`."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import GoalSet, goal_distances
from kitchen_suite.tasks.success import Success

# Least initial distance [rad, m] that shares are relative to: a hand or an object that starts near has come far.
_LEAST_DISTANCE = 0.1


class Shaping(NamedTuple):
    """Positions and shares on which the rewards of a step depend beside its achieved goals.

    Attributes:
      initial_achieved: `(..., k)`, achieved goals at the reset [rad, m, quaternion].
      initial_hand_distances: `(..., n)`, distance of the hand from each task's handle at the reset [m].
      hand_distances: `(..., n)`, these distances after the step [m].
      previous_achieved: `(..., k)`, achieved goals before the step.
      best_approach: `(..., n)`, greatest share of the way to the handle covered before the step.
      best_progress: `(..., n)`, greatest share of the way to the goal covered before the step.
      previously_completed: `(..., n)`, whether each task was completed before the step.
    """

    initial_achieved: NDArray[np.float64]
    initial_hand_distances: NDArray[np.float64]
    hand_distances: NDArray[np.float64]
    previous_achieved: NDArray[np.float64]
    best_approach: NDArray[np.float64]
    best_progress: NDArray[np.float64]
    previously_completed: NDArray[np.bool_]

    @classmethod
    def start(cls, achieved: NDArray[np.float64], hand_distances: NDArray[np.float64], goals: GoalSet) -> Self:
        """Returns what is remembered at a reset."""
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

    def restarted(self, mask: NDArray[np.bool_], achieved: NDArray[np.float64], goals: GoalSet) -> Self:
        """Returns what is remembered if, where `mask` `(...)`, the last step counts as a reset.

        Args:
          mask: which episodes.
          achieved: `(..., k)`, achieved goals after that step.
          goals: the tasks.
        """
        restart = self.start(achieved, self.hand_distances, goals)
        return type(self)(*(np.where(mask[..., np.newaxis], new, old) for new, old in zip(restart, self, strict=True)))

    def after(
        self,
        achieved: NDArray[np.float64],
        completed: NDArray[np.bool_],
        hand_distances: NDArray[np.float64],
        goals: GoalSet,
    ) -> Self:
        """Returns what is remembered after one more step.

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
    def approach(self) -> NDArray[np.float64]:
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

    approach: NDArray[np.float64]
    previous_approach: NDArray[np.float64]
    progress: NDArray[np.float64]
    previous_progress: NDArray[np.float64]
    is_relabelled: NDArray[np.bool_]
    completed: NDArray[np.bool_]
    previously_completed: NDArray[np.bool_]

    def masked(self, mask: NDArray[np.bool_]) -> Self:
        """Returns the shares with those of tasks outside a mask `(..., n)` set to 0 and False, which pay nothing."""
        return type(self)(*(np.where(mask, part, np.zeros((), part.dtype)) for part in self))


def shares(
    shaping: Shaping,
    *,
    success: Success,
    achieved: NDArray[np.float64],
    desired: NDArray[np.float64],
) -> Shares:
    """Returns how far each task has come.

    Args:
      shaping: what is remembered, after the step.
      success: decides which tasks are complete.
      achieved: `(..., k)`, achieved goals after the step.
      desired: `(..., k)` or `(k,)`, goals that may be others than the episode's.
    """
    goals, before = success.goals, shaping.previous_achieved
    with np.errstate(over="ignore"):
        initial = goal_distances(shaping.initial_achieved, desired, goals.starts)
        distances = goal_distances(achieved, desired, goals.starts)
        previous = goal_distances(before, desired, goals.starts)
    is_relabelled = np.logical_or.reduceat(desired != goals.desired, goals.starts, axis=-1)
    # Of another goal, only the last step before is known.
    previously_completed = np.where(
        is_relabelled, success.within(before, previous, desired=desired), shaping.previously_completed
    )
    return Shares(
        approach=shaping.approach,
        previous_approach=shaping.best_approach,
        progress=covered(distances, initial),
        previous_progress=np.where(is_relabelled, covered(previous, initial), shaping.best_progress),
        is_relabelled=is_relabelled,
        completed=previously_completed | success.within(achieved, distances, desired=desired),
        previously_completed=previously_completed,
    )


def covered(distances: NDArray[np.float64], initial: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the share in [0, 1] of initial distances that has been covered; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.fmax(1.0 - distances / np.maximum(initial, _LEAST_DISTANCE), 0.0)

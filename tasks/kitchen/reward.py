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

import abc
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.kitchen.shaping import Shares

_APPROACH_WEIGHT, _PROGRESS_WEIGHT = 0.25, 0.75


class SparseReward:
    """One for each task completed in a step.

    Attributes:
      terms: names of the terms, which sum to the reward.
    """

    terms = ("completion",)

    def __call__(self, completions: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` by name.

        Args:
          completions: `(..., n)`, whether each task was completed in the step.
        """
        return {"completion": np.add.reduce(completions, axis=-1, dtype=np.float64)}


class ShapedReward(abc.ABC):
    """A reward that follows the tasks' potential.

    Attributes:
      terms: names of the terms, which sum to the reward.
    """

    terms: ClassVar[tuple[str, ...]] = ("approach", "progress", "completion")

    def __call__(self, shares: Shares) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` by name.

        Args:
          shares: how far each task has come.
        """
        return {
            name: np.add.reduce(np.ascontiguousarray(each), axis=-1)
            for name, each in zip(self.terms, self._by_task(shares), strict=True)
        }

    @abc.abstractmethod
    def _by_task(self, shares: Shares) -> tuple[NDArray[np.float64], ...]:
        """Returns the terms `(..., n)` of each task."""


class DenseReward(ShapedReward):
    """The potential of each task after the step."""

    def _by_task(self, shares: Shares) -> tuple[NDArray[np.float64], ...]:
        remains = np.where(shares.completed, 0.0, 1.0)
        return (
            _APPROACH_WEIGHT * shares.approach * remains,
            _PROGRESS_WEIGHT * shares.progress * remains,
            1.0 - remains,
        )


class DenseGainReward(ShapedReward):
    """Gains of each task over its greatest shares so far: at most 1 in an episode, so that no cycle pays.

    For a goal other than the episode's, as hindsight relabelling has them, the greatest progress so far is unknown. The
    change of the progress, which may be negative, stands for the gain then.
    """

    def _by_task(self, shares: Shares) -> tuple[NDArray[np.float64], ...]:
        remains = np.where(shares.completed, 0.0, 1.0)
        change = shares.progress - shares.previous_progress
        gain = np.where(shares.is_relabelled, change, np.maximum(change, 0.0))
        paid = _APPROACH_WEIGHT * shares.previous_approach + _PROGRESS_WEIGHT * shares.previous_progress
        return (
            _APPROACH_WEIGHT * (shares.approach - shares.previous_approach) * remains,
            _PROGRESS_WEIGHT * gain * remains,
            np.where(shares.completed & ~shares.previously_completed, 1.0 - paid, 0.0),
        )


REWARDS: Mapping[str, type[SparseReward] | type[DenseReward] | type[DenseGainReward]] = MappingProxyType(
    {"sparse": SparseReward, "dense": DenseReward, "dense_gain": DenseGainReward}
)

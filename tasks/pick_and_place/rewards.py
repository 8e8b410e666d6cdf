"""Rewards for objects that are put somewhere, on arrays of shape `(..., O)`.

`sparse` is 1 for each object that a step has put where it was asked for.

`dense` and `dense_gain` follow a potential of each requested object, in [0, 1]: the hand reaches it, grasps it, lifts
it, carries it to its place, and lets it go there. Each of these has a share in [0, 1] with a weight; the potential is 1
once the task has been completed. `dense` is the potential after each step, `dense_gain` how far its parts exceed their
greatest values before. The greatest share of reaching so far counts, since the hand must leave an object for the next
one; of the others, in `dense`, the present share counts, so that an object that is dropped costs.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.rewards import completions
from kitchen_suite.tasks.terms import RewardTerm
from kitchen_suite.types import Array

WEIGHTS: Mapping[str, float] = MappingProxyType({"reach": 0.2, "grasp": 0.1, "lift": 0.2, "carry": 0.3, "release": 0.2})
"""Weights of the shares of the potential of an object, by stage."""

STAGES = tuple(WEIGHTS)


class StageStep(Protocol):
    """A control step, as far as terms of the dense rewards read it."""

    @property
    def stages(self) -> "Stages":
        """How far each requested object has come, before and after the step."""


class Stages(NamedTuple):
    """How far each object has come; zeros for those that are not requested.

    Attributes:
      shares: `(..., O, 5)`, by stage after the step, each in [0, 1].
      best: `(..., O, 5)`, greatest ones up to the step.
      previous_best: `(..., O, 5)`, greatest ones before it.
      completed: `(..., O)`, whether the task has been completed.
      previously_completed: `(..., O)`, the same before the step.
    """

    shares: Array
    best: Array
    previous_best: Array
    completed: NDArray[np.bool_]
    previously_completed: NDArray[np.bool_]


def _summed(by_object: Array) -> Array:
    """Returns the sums `(...)` over the objects of values `(..., O)`."""
    # In C order, a row has the same sum alone and among many.
    return np.add.reduce(np.ascontiguousarray(by_object), axis=-1)


def _stage(name: str) -> RewardTerm[StageStep]:
    """Returns the part of a stage in the potential after the step, of objects whose task is not completed."""
    column = STAGES.index(name)

    def term(step: StageStep) -> Array:
        stages = step.stages
        share = (stages.best if name == "reach" else stages.shares)[..., column]
        return _summed(np.where(stages.completed, 0.0, WEIGHTS[name] * share))

    return term


def _gain(name: str) -> RewardTerm[StageStep]:
    """Returns the gain of a stage over its greatest value before."""
    column = STAGES.index(name)

    def term(step: StageStep) -> Array:
        stages = step.stages
        gain = stages.best[..., column] - stages.previous_best[..., column]
        return _summed(np.where(stages.completed, 0.0, WEIGHTS[name] * gain))

    return term


def _completed(step: StageStep) -> Array:
    """The number of objects whose task has been completed."""
    return _summed(np.where(step.stages.completed, 1.0, 0.0))


def _completion_gain(step: StageStep) -> Array:
    """The rest of the potential up to its greatest value, 1, for each task that the step completes."""
    stages = step.stages
    paid = np.zeros(stages.completed.shape)
    for column, name in enumerate(STAGES):
        paid = paid + WEIGHTS[name] * stages.previous_best[..., column]
    return _summed(np.where(stages.completed & ~stages.previously_completed, 1.0 - paid, 0.0))


REWARDS: Mapping[str, Mapping[str, RewardTerm]] = MappingProxyType(
    {
        "sparse": MappingProxyType({"completion": completions}),
        "dense": MappingProxyType({**{name: _stage(name) for name in STAGES}, "completion": _completed}),
        "dense_gain": MappingProxyType({**{name: _gain(name) for name in STAGES}, "completion": _completion_gain}),
    }
)
"""The terms of each reward, by the names of reward and term."""

"""Success of a user's task by conditions of its own."""

import functools
import operator
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Condition, Transition


class OwnSuccess(NamedTuple):
    """Success of episodes by the conditions of a task's class.

    Attributes:
      conditions: `(...)` by name, whether each was true after the last control step.
      reached: `(...)`, whether all of them have been true after one control step, the last one or one before.
    """

    conditions: dict[str, NDArray[np.bool_]]
    reached: NDArray[np.bool_]

    def after(self, conditions: dict[str, NDArray[np.bool_]]) -> Self:
        """Returns that after one more step, with the conditions `(...)` by name that are true then."""
        return type(self)(conditions, self.reached | _all(conditions))


class ExtraSuccesses(EpisodePart):
    """The `extra_successes` of a task, which take the place of the success of its domain."""

    name = "own_success"
    suits_any_model = True

    def __init__(self, conditions: Mapping[str, Condition]) -> None:
        """Takes the conditions by name: functions of a step that return fresh arrays."""
        self._conditions = conditions

    def holds(self, step: Transition) -> NDArray[np.bool_]:
        """Returns whether `(...)` all conditions are true after a control step."""
        return _all({name: condition(step) for name, condition in self._conditions.items()})

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> OwnSuccess:
        return OwnSuccess({name: np.array(False) for name in self._conditions}, np.array(False))

    def after(self, part: OwnSuccess, simulation: Simulation, step: Transition, draws: Draws) -> OwnSuccess:
        return part.after({name: condition(step) for name, condition in self._conditions.items()})

    def corrected(self, part: OwnSuccess, info: dict[str, NDArray]) -> dict[str, NDArray]:
        infos = {"is_success": np.array(part.reached)}
        if "success_at_any_time" in info:
            infos["success_at_any_time"] = np.array(part.reached)
        return {**info, **infos}

    def succeeds(self, part: OwnSuccess, success: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return _all(part.conditions)

    def info(self, part: OwnSuccess) -> dict[str, NDArray]:
        return {f"success/{name}": np.array(condition) for name, condition in part.conditions.items()}


def _all(conditions: Mapping[str, NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Returns whether `(...)` all conditions `(...)` are true."""
    return functools.reduce(operator.and_, conditions.values())

"""Reasons to terminate an episode that a user's task adds."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Termination, Transition

# By name, whether `(...)` each reason ended the episode in the last control step.
Ended = dict[str, NDArray[np.bool_]]


class ExtraTerminations(EpisodePart):
    """The `extra_terminations` of a task."""

    name = "terminations"
    is_saved = False
    suits_any_model = True

    def __init__(self, terms: Mapping[str, Termination]) -> None:
        """Takes the reasons by name: functions of a step that return fresh arrays."""
        self._terms = terms

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> Ended:
        return dict.fromkeys(self._terms, np.array(False))

    def evaluated(self, part: Ended) -> Ended:
        return dict.fromkeys(self._terms, np.array(False))

    def after(self, part: Ended, simulation: Simulation, step: Transition, draws: Draws) -> Ended:
        return {name: term(step) for name, term in self._terms.items()}

    def terminates(self, part: Ended) -> NDArray[np.bool_]:
        ended: NDArray[np.bool_] = np.logical_or.reduce([*part.values()])
        return ended

    def info(self, part: Ended) -> dict[str, NDArray]:
        return {f"termination/{name}": np.array(ended) for name, ended in part.items()}

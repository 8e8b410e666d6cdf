"""When episodes reach their success, and whether it lasts."""

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.extra_successes import ExtraSuccesses
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Transition


class SuccessTimes(NamedTuple):
    """The success of episodes up to the last control step.

    Attributes:
      steps: `(...)`, control steps made.
      success_at_end: `(...)`, whether all that the episode asks for holds after the last control step.
      steps_to_success: `(...)`, control step at which the episode first succeeded; -1 if it has not.
    """

    steps: NDArray[np.int64]
    success_at_end: NDArray[np.bool_]
    steps_to_success: NDArray[np.int64]

    def after(self, reached: NDArray[np.bool_], holds: NDArray[np.bool_]) -> Self:
        """Returns those after one more step, given whether `(...)` episodes have succeeded, and whether it holds."""
        steps = self.steps + 1
        is_first = reached & (self.steps_to_success < 0)
        return type(self)(steps, holds, np.where(is_first, steps, self.steps_to_success))


class LastingSuccess(EpisodePart):
    """Keeps when episodes reach their success, and whether it holds; infos have both."""

    name = "lasting_success"
    suits_any_model = True

    def __init__(self, mdp: MDP, own: ExtraSuccesses | None) -> None:
        """Takes the MDP, and what decides a success of the task's own."""
        self._mdp = mdp
        self._own = own

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> SuccessTimes:
        return SuccessTimes(np.array(0), np.array(False), np.array(-1))

    def after(self, part: SuccessTimes, simulation: Simulation, step: Transition, draws: Draws) -> SuccessTimes:
        if self._own is not None:
            holds = self._own.holds(step)
            return part.after(holds, holds)
        # The reward has not been computed yet, and infos may name its terms.
        state = step.after._replace(terms=self._mdp.no_reward(part.steps.shape))
        reached = np.asarray(self._mdp.info(state)["is_success"], bool)
        return part.after(reached, self._mdp.succeeds(state))

    def info(self, part: SuccessTimes) -> dict[str, NDArray]:
        return {name: np.array(getattr(part, name)) for name in ("success_at_end", "steps_to_success")}

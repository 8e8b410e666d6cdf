"""Markov decision processes whose tasks are completed one by one, as those of both kitchens."""

import dataclasses
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import Progress
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.rewards import SPARSE_TERMS

Reading = TypeVar("Reading")
State = TypeVar("State", bound=Any)


class CompletionState(Protocol):
    """State of an episode that asks for some of `n` tasks.

    Attributes:
      progress: completion of the tasks.
      requested: `(..., n)`, whether the episode asks for each task.
    """

    @property
    def progress(self) -> Progress: ...

    @property
    def requested(self) -> NDArray[np.bool_]: ...


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompletionMDP(MDP[Reading, State], Generic[Reading, State]):
    """Settings of tasks that are completed one by one, and the mathematics of their completion.

    States are as in `CompletionState`.

    Attributes:
      is_dense: whether the reward follows how far the tasks have come: it then has a part of the state, which needs the
        distances of the hand from the handles.
      terminate_on_tasks_completed: whether an episode terminates once all that it asks for has been completed.
    """

    is_dense: bool
    terminate_on_tasks_completed: bool

    def all_completed(self, state: CompletionState) -> NDArray[np.bool_]:
        """Returns whether `(...)` all tasks that the episode asks for have been completed."""
        completed: NDArray[np.bool_] = np.logical_and.reduce(state.progress.completed | ~state.requested, axis=-1)
        return completed

    def complete(self, state: State) -> NDArray[np.bool_]:
        progress: Progress = state.progress
        return progress.within & progress.completed

    def succeeds(self, state: State) -> NDArray[np.bool_]:
        """Returns whether `(...)` all tasks that the episode asks for have been completed, and all still are."""
        holds: NDArray[np.bool_] = np.logical_and.reduce(self.complete(state) | ~state.requested, axis=-1)
        return holds

    def terminates(self, state: State) -> NDArray[np.bool_]:
        return self.all_completed(state) & self.terminate_on_tasks_completed

    def reward_info(self, state: State) -> dict[str, NDArray]:
        """Returns the terms of the last step's reward as infos have them; none where these follow from completions."""
        if state.terms.keys() == SPARSE_TERMS:
            return {}
        return super().reward_info(state)

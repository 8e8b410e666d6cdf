"""Measures of episodes, from their infos."""

import abc
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# Verdicts, measures, and the control steps at which goals were completed, by the goals' names.
Metrics = dict[str, bool | float | dict[str, int]]


class Completions(NamedTuple):
    """The tasks of an episode that asks for several.

    Attributes:
      tasks: the names of all `n` tasks.
      asked: `(n,)`, which of them the episode asks for.
      steps: `(n,)`, control step, from 1, at which each was first completed; not positive where it was not.
    """

    tasks: tuple[str, ...]
    asked: NDArray[np.bool_]
    steps: NDArray[np.int64]

    @property
    def steps_by_task(self) -> dict[str, int | None]:
        """The tasks that are asked for, each with the control step of its completion or None."""
        rows = zip(self.tasks, self.asked.tolist(), self.steps.tolist(), strict=True)
        return {name: step if step > 0 else None for name, is_asked, step in rows if is_asked}


class MeasuredTask(abc.ABC):
    """A task with metrics of its episodes, read from their infos."""

    @abc.abstractmethod
    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns the metrics of an episode.

        Args:
          infos: its last infos, of the Gymnasium environment or from a recording; arrays without leading axis.
        """

    @abc.abstractmethod
    def progress_in(self, infos: Mapping[str, Any]) -> NDArray:
        """Returns how far episodes have come, `(...)`, from their infos: a number that grows towards success."""

    def completions_in(self, infos: Mapping[str, Any]) -> Completions | None:
        """Returns which tasks an episode asks for and has completed, from infos without leading axis.

        None if the task does not consist of tasks that can be counted.
        """
        del infos
        return None

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        """Names of the task's goals, and whether each is reached after each step of a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.

        Returns:
          `n` names and a mask `(T + 1, n)`; None if the arrays do not determine it.
        """
        return None

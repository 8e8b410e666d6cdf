"""Metrics, progress and completions of a task's episodes, read from their records: infos, and recorded arrays."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from dm_control import composer
from numpy.typing import NDArray

from kitchen_suite.types import Array

# Verdicts, measures, and the control steps at which goals were completed, by the goals' names.
Metrics = dict[str, bool | float | dict[str, int]]


class Completions(NamedTuple):
    """The tasks of an episode that asks for several.

    Attributes:
      tasks: the names of all `n` tasks.
      requested: `(n,)`, which of them the episode asks for.
      steps: `(n,)`, control step, from 1, at which each was first completed; not positive where it was not.
    """

    tasks: tuple[str, ...]
    requested: NDArray[np.bool_]
    steps: NDArray[np.int64]

    @property
    def steps_by_task(self) -> dict[str, int | None]:
        """The requested tasks, each with the control step of its completion or None."""
        rows = zip(self.tasks, self.requested.tolist(), self.steps.tolist(), strict=True)
        return {name: step if step > 0 else None for name, is_requested, step in rows if is_requested}


class Records:
    """Reads metrics, progress and completions from the records of a task's episodes: infos, and recorded arrays.

    This class knows `is_success` among the infos alone, and episodes that start from a seed. Tasks of the suite have
    classes of their own.
    """

    # The modules of tasks import those of their records.
    _task: Any

    def __init__(self, task: composer.Task) -> None:
        """Stores the task."""
        self._task = task

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns the metrics of an episode, `success` among them.

        Args:
          infos: its last infos, of the Gymnasium environment or from a recording; arrays without leading axis.
        """
        return {"success": bool(infos["is_success"])}

    def progress(self, infos: Mapping[str, Any]) -> NDArray:
        """Returns how far episodes have come, `(...)`, from their infos: a number that grows towards success."""
        return np.asarray(infos["is_success"], np.float64)

    def completions(self, infos: Mapping[str, Any]) -> Completions | None:
        """Returns which tasks an episode asks for and has completed, from infos without leading axis.

        None if the task does not consist of tasks that can be counted.
        """
        return None

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        """Names of the task's goals, and whether each is reached after each step of a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.

        Returns:
          `n` names and a mask `(T + 1, n)`; None if the arrays do not determine it.
        """
        return None


class OpeningRecords(Records):
    """Reads the records of a task that opens a drawer or a door."""

    def __init__(self, task: composer.Task, opened: str) -> None:
        """Stores the task, and what it opens.

        Args:
          task: the task.
          opened: `drawer`, whose opening is in m, or `door`, whose opening is a fraction of the goal; infos have it as
            `drawer_opening` or `door_opening`.
        """
        super().__init__(task)
        self._opened = opened

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether the drawer or door is open, whether it was at any time, and how far it is open."""
        return {
            "success": bool(infos["is_success"]),
            "success_at_any_time": bool(infos["success_at_any_time"]),
            f"{self._opened}_opening": float(self.progress(infos)),
        }

    def progress(self, infos: Mapping[str, Any]) -> Array:
        """Returns how far the drawer or door is open [m, or as a fraction of the goal]."""
        return infos[f"{self._opened}_opening"]

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        key = "info/is_success"
        return ((self._opened,), arrays[key][:, np.newaxis]) if key in arrays else None

"""Training on tasks drawn for each episode: the less a task succeeds, the more often it is drawn."""

from collections.abc import Mapping
from typing import Any, Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.base import SuiteTask

# Weight of a task that always succeeds, relative to 1 more for one that never does.
_LEAST_WEIGHT = 0.05

# Number of episodes of a task over which its success is averaged.
_MEMORY = 50


class DrawingTask(Protocol):
    """A task that draws what each episode asks for.

    Attributes:
      drawn_tasks: names of the `n` tasks that are drawn from.
      task_weights: `(n,)`, with which later episodes draw them.
    """

    drawn_tasks: tuple[str, ...]
    task_weights: Any


class TaskBalance:
    """Sets the weights with which tasks are drawn: 1.05 minus their recent success.

    Attributes:
      success: `(n,)`, recent success rates, in the order of the tasks.
    """

    def __init__(self, task: DrawingTask) -> None:
        """Takes the task that starts the episodes; none of those that it draws has succeeded yet."""
        self._task, self._names = task, task.drawn_tasks
        self.success = np.zeros(len(self._names))

    @classmethod
    def of(cls, task: SuiteTask) -> Self | None:
        """Returns the balance of a task; None if it does not draw tasks."""
        return cls(cast(DrawingTask, task)) if task.drawn_tasks else None

    def add(self, infos: Mapping[str, Any], ended: NDArray[np.bool_]) -> dict[str, NDArray]:
        """Adds the episodes that have ended.

        Args:
          infos: last infos of episodes, with a leading axis.
          ended: `(n,)`, which of them have ended.

        Returns:
          Successes of the tasks asked for, by the names of their curves.
        """
        asked, completed = infos["requested_tasks_mask"], infos["episode_task_completions_mask"]
        # Of tasks asked in turn, those that were never attempted say nothing.
        asked = infos.get("attempted_tasks_mask", asked)
        for i in np.flatnonzero(ended).tolist():
            self.success += np.where(asked[i], completed[i] - self.success, 0.0) / _MEMORY
        self._task.task_weights = 1.0 + _LEAST_WEIGHT - self.success
        each = {name: completed[ended & asked[:, column], column] for column, name in enumerate(self._names)}
        return {f"episode/success/{name}": done.astype(np.float64) for name, done in each.items() if done.size}

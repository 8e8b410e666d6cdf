"""Training on tasks drawn for each episode: the less a task succeeds, the more often it is drawn."""

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.base import SuiteTask
from kitchen_suite.tasks.kitchen.mdp import KitchenMDP
from kitchen_suite.tasks.kitchen.requesting import RequestingTask

# Weight of a task that always succeeds, relative to 1 more for one that never does.
_LEAST_WEIGHT = 0.05

# Number of episodes of a task over which its success is averaged.
_MEMORY = 50


class TaskBalance:
    """Sets the weights with which tasks are drawn: 1.05 minus their recent success.

    Attributes:
      success: `(n,)`, recent success rates, in the order of the tasks.
    """

    def __init__(self, task: RequestingTask, names: Sequence[str]) -> None:
        """Takes the task that starts the episodes, and the names of its tasks `(n,)`; none has succeeded yet."""
        self._task, self._names = task, names
        self.success = np.zeros(len(names))

    @classmethod
    def of(cls, task: SuiteTask) -> Self | None:
        """Returns the balance of a task; None if it does not draw tasks."""
        mdp = task.mdp
        if not isinstance(task, RequestingTask) or not isinstance(mdp, KitchenMDP) or mdp.task_draw is None:
            return None
        return cls(task, mdp.goals.tasks)

    def add(self, infos: Mapping[str, Any], ended: NDArray[np.bool_]) -> dict[str, NDArray]:
        """Adds the episodes that have ended.

        Args:
          infos: last infos of episodes, with a leading axis.
          ended: `(n,)`, which of them have ended.

        Returns:
          Successes of the tasks asked for, by the names of their curves.
        """
        asked, completed = infos["requested_tasks_mask"], infos["episode_task_completions_mask"]
        for i in np.flatnonzero(ended).tolist():
            self.success += np.where(asked[i], completed[i] - self.success, 0.0) / _MEMORY
        self._task.task_weights = 1.0 + _LEAST_WEIGHT - self.success
        each = {name: completed[ended & asked[:, column], column] for column, name in enumerate(self._names)}
        return {f"episode/success/{name}": done.astype(np.float64) for name, done in each.items() if done.size}

"""Metrics and completions of episodes with objects."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.metrics import Completions, Metrics, Records
from kitchen_suite.tasks.orders import REQUESTED_ORDER, sequence_of


class ObjectRecords(Records):
    """Reads the records of episodes that ask for objects to be put somewhere."""

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether everything requested was done, the control step of each task, and how many objects fell."""
        completed = self.completions(infos).steps_by_task
        return {
            "success": all(step is not None for step in completed.values()),
            "tasks_completed": {name: step for name, step in completed.items() if step is not None},
            "objects_dropped": float(infos["objects_dropped"]),
        }

    def progress(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return (infos["completion_steps"] > 0).sum(axis=-1)

    def completions(self, infos: Mapping[str, Any]) -> Completions:
        order = infos[REQUESTED_ORDER]
        names = self._task.requests.names(order, infos["goal_places"], infos["start_places"], infos["starts_closed"])
        steps = infos["completion_steps"][sequence_of(order)]
        return Completions(tuple(names), np.full(len(names), True), steps)

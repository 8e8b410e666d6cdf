"""Metrics and completions of episodes in generated kitchens."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.generated_kitchens.requests import verb_of
from kitchen_suite.tasks.metrics import Completions, Metrics, Records
from kitchen_suite.tasks.orders import REQUESTED


class PartRecords(Records):
    """Reads the records of episodes that ask for parts of a generated kitchen."""

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether everything requested was completed, and the control step of each completion."""
        completed = self.completions(infos).steps_by_task
        return {
            "success": all(step is not None for step in completed.values()),
            "tasks_completed": {name: step for name, step in completed.items() if step is not None},
        }

    def progress(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return (infos["completion_steps"] > 0).sum(axis=-1)

    def completions(self, infos: Mapping[str, Any]) -> Completions:
        slots, goal = np.flatnonzero(infos[f"{REQUESTED}_mask"]), infos["goal_openings"]
        scene = self._task.scene
        tasks = tuple(f"{verb_of(scene.parts[k][1], bool(goal[k]))} {scene.part_names[k]}" for k in slots)
        return Completions(tasks, np.full(len(tasks), True), infos["completion_steps"][slots])

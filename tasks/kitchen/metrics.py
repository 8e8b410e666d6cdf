"""Metrics and completions of the kitchen's episodes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.metrics import Completions, Metrics, Records
from kitchen_suite.tasks.orders import REQUESTED


class KitchenRecords(Records):
    """Reads the records of a kitchen task's episodes."""

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether all requested tasks were completed, and the control step of each completion."""
        completions = self.completions(infos)
        steps = self._task.mdp.goals.by_completion(completions.steps)
        return {"success": len(steps) == int(completions.requested.sum()), "tasks_completed": steps}

    def progress(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return infos["episode_task_completions_mask"].sum(axis=-1)

    def completions(self, infos: Mapping[str, Any]) -> Completions:
        tasks = self._task.mdp.goals.tasks
        return Completions(tasks, infos.get(f"{REQUESTED}_mask", np.full(len(tasks), True)), infos["completion_steps"])

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        success, goals = self._task.mdp.success, self._task.mdp.goals
        keys = [f"observation/achieved_goal/{task}" for task in goals.tasks]
        achieved = arrays.get("observation/achieved_goal")
        if arrays.keys() >= {*keys}:
            achieved = np.concatenate([arrays[key] for key in keys], axis=1)
        if achieved is not None:
            within: NDArray[np.bool_] | None = success.within(achieved)
        else:
            distances = arrays.get("info/task_distances")
            within = None if distances is None else success.within_distances(distances)
        if within is None:
            return None
        requested = arrays.get(f"info/{REQUESTED}_mask", arrays.get(f"observation/{REQUESTED}"))
        return goals.tasks, within if requested is None else within & (requested > 0)

"""Progress, reward and completion of the kitchen's tasks, as attributes of the task and in recordings."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import Progress
from kitchen_suite.tasks.kitchen.requested import REQUESTED
from kitchen_suite.tasks.kitchen.requesting import RequestingTask
from kitchen_suite.tasks.measured import Completions, Metrics
from kitchen_suite.tasks.success import ThresholdSuccess


class KitchenProgress(RequestingTask):
    """A task of the kitchen's MDP that reports how far its episode has come."""

    _reward_name: str
    _success_options: Mapping[str, Any]

    @property
    def success_options(self) -> dict[str, Any]:
        """The arguments `success` and `threshold` that the task was given."""
        return dict(self._success_options)

    @property
    def threshold(self) -> float | dict[str, float] | None:
        """Distance from the goal below which a task is complete [rad, m], by task if they differ; None if `strict`."""
        if not isinstance(self._mdp.success, ThresholdSuccess):
            return None
        thresholds = self._mdp.success.thresholds
        if isinstance(thresholds, float):
            return thresholds
        return dict(zip(self._mdp.goals.tasks, thresholds.tolist(), strict=True))

    @property
    def reward_name(self) -> str:
        """Key of the reward function in `REWARDS`."""
        return self._reward_name

    @property
    def reward_terms(self) -> dict[str, float]:
        """The terms of the last step's reward by name; zeros before the first step of an episode."""
        return {name: float(term) for name, term in self._mdp.terms(self._state).items()}

    @property
    def progress(self) -> Progress:
        """Completion of the tasks; arrays of shape `(n,)`, in configured order."""
        return self._state.progress

    @property
    def task_distances(self) -> NDArray[np.float64]:
        """Distance of each task from its goal, in configured order [rad, m]."""
        return self._state.distances.copy()

    @property
    def tasks_to_complete(self) -> list[str]:
        """Tasks still to be completed, in configured order."""
        return self._mdp.goals.names(self.progress.remaining)

    @property
    def step_task_completions(self) -> list[str]:
        """Tasks rewarded in the last step, in configured order."""
        return self._mdp.goals.names(self.progress.completions)

    @property
    def episode_task_completions(self) -> list[str]:
        """Tasks completed in this episode, in order of completion."""
        return list(self.completion_steps)

    @property
    def completion_steps(self) -> dict[str, int]:
        """Control step, from 1, at which each task was first completed, in order of completion."""
        return self._mdp.goals.by_completion(self.progress.completion_steps)

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether all tasks asked were completed, and the control step of each completion."""
        completions = self.completions_in(infos)
        steps = self._mdp.goals.by_completion(completions.steps)
        return {"success": len(steps) == int(completions.asked.sum()), "tasks_completed": steps}

    def progress_in(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return infos["episode_task_completions_mask"].sum(axis=-1)

    def completions_in(self, infos: Mapping[str, Any]) -> Completions:
        tasks = self._mdp.goals.tasks
        asked = infos.get(f"{REQUESTED}_mask", np.full(len(tasks), True))
        return Completions(tuple(tasks), asked, infos["completion_steps"])

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        achieved, goals = self._recorded_goals(arrays), self._mdp.goals
        distances = arrays.get("info/task_distances") if achieved is None else goals.distances(achieved)
        within = None if distances is None else self._mdp.success.within_recorded(achieved, distances)
        if within is None:
            return None
        asked = arrays.get(f"info/{REQUESTED}_mask", arrays.get(f"observation/{REQUESTED}"))
        return goals.tasks, within if asked is None else within & (asked > 0)

    def _recorded_goals(self, arrays: Mapping[str, NDArray]) -> NDArray[np.float64] | None:
        """Returns the achieved goals `(T + 1, k)` in a recording, if it has them."""
        key = "observation/achieved_goal"
        by_task = [f"{key}/{task}" for task in self._mdp.goals.tasks]
        if arrays.keys() >= {*by_task}:
            return np.concatenate([arrays[name] for name in by_task], axis=1)
        return arrays.get(key)

"""An expert that completes tasks of the kitchen in a random order, as people do who play with it."""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kitchen_suite import checks
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS
from kitchen_suite.policies.experts.kitchen import KitchenExpert
from kitchen_suite.policies.experts.trajectories import JointTrajectory
from kitchen_suite.tasks.goals import GoalSet, Thresholds
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.kitchen.task import KitchenTask
from kitchen_suite.types import Array

_REPERTOIRES = {"seven": DEFAULT_TASKS, "twenty": tuple(GOALS)}  # Repertoires by name.

# The task whose goal has another object at rest, and the task that puts this to rest.
_NEEDS = {"hinge cabinet": "close left hinge cabinet"}


class UndirectedExpert(KitchenExpert):
    """Chooses its next task at random among those that are not complete, whatever the episode asks for.

    A task is left once it is complete, or after one attempt. Data of such episodes are undirected, as those of D4RL's
    `partial` and `mixed`; with tasks that undo others they go on without end, as OGBench's `play`.

    In some episodes, in which it `is_directed`, it does what is asked for.
    """

    is_directed: bool

    # Goals that exclude each other are wanted one after the other.
    _build_goals = staticmethod(functools.partial(GoalSet.build, GOALS))

    def __init__(
        self,
        tasks: Sequence[str],
        *,
        repertoire: str | Sequence[str] = "seven",
        directed: float = 0.0,
        spare_last: bool = False,
        goals: Mapping[str, ArrayLike] | None = None,
        threshold: Thresholds | None = None,
        **options: Any,
    ) -> None:
        """Builds an expert for episodes that ask for some tasks.

        Args:
          tasks: names of the tasks that every episode asks for; empty where they are drawn.
          repertoire: the tasks to choose from: `seven`, the reference's; `twenty`, all of
            `tasks.GOALS`, of which ten undo the others; or a list of names.
          directed: probability that an episode is one in which it does the tasks that are asked for, and no others.
          spare_last: whether it never begins the last of these tasks that is not complete.
          goals: see `KitchenExpert`; those of other tasks than the repertoire's are left out.
          threshold: see `KitchenExpert`; those of other tasks are left out.
          **options: of `KitchenExpert`.
        """
        if isinstance(repertoire, str):
            repertoire = _REPERTOIRES[checks.choice(repertoire, _REPERTOIRES, "repertoire")]
        names = [checks.choice(task, GOALS, "repertoire") for task in checks.unique_names(repertoire, "repertoire")]
        self._directed = checks.number(directed, "directed", maximum=1.0)
        goals = {task: value for task, value in (goals or {}).items() if task in names}
        if isinstance(threshold, Mapping):
            threshold = {task: value for task, value in threshold.items() if task in names}
        super().__init__(names, goals=goals, threshold=threshold, **options)
        self._asked = tuple(tasks)
        self._spares_last = checks.boolean(spare_last, "spare_last")
        if not self._asked and (self._directed or self._spares_last):
            raise ValueError("directed and spare_last need a task that asks for the same tasks in every episode")
        if self._directed and not {*self._asked} <= {*self._goals.tasks}:
            raise ValueError(f"directed episodes need a repertoire with {', '.join(self._asked)}")

    @classmethod
    def _task_settings(cls, task: KitchenTask) -> dict[str, Any]:
        tasks = () if task.mdp.ordering.draw else task.mdp.goals.tasks
        return {**super()._task_settings(task), "tasks": tasks, "observes_requests": False, "in_order": False}

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self._chosen: tuple[str, ...] = ()
        self.is_directed = bool(generator.random() < self._directed) if self._directed else False

    @property
    def under_way(self) -> str:
        """Name of the task that it has turned to; empty where nothing is left to do."""
        return next(iter(self._chosen), "")

    def _requested(self, observation: Array) -> tuple[str, ...]:
        return self._chosen

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        distances = self._relative_distances(observation)
        # Whether the task under way is complete, has been attempted, or is none.
        if not self._remaining or distances[self._remaining[0]] < self._done or self._has_failed:
            self._chosen = self._choose(distances)
        return super()._next_trajectory(observation, joints)

    def _choose(self, distances: Mapping[str, float]) -> tuple[str, ...]:
        """Draws the next task; none where all are complete."""
        missing = [task for task in self._asked if distances.get(task, 1.0) >= 1.0]
        spared = missing if self._spares_last and len(missing) == 1 else []
        candidates = [
            task
            for task in (self._asked if self.is_directed else self._goals.tasks)
            if distances[task] >= 1.0 and task not in spared and distances.get(_NEEDS.get(task, ""), 0.0) < 1.0
        ]
        return (str(self._generator.choice(candidates)),) if candidates else ()

"""The seven goals of the kitchen, and the mathematics of reaching them.

The functions work on arrays of shape `(..., n)`: one environment has no leading axis, a batch has one or more.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks

# Distance below which a task counts as complete, over all joints of the task together [rad, m]; the reference's.
THRESHOLD = 0.3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Goal:
    """What one task asks for.

    Attributes:
      description: what is to be done, in one line.
      elements: where its values stand in the 21 object positions of the observation.
      value: where they should be [rad, m; the kettle: m and a quaternion w, x, y, z].
    """

    description: str
    elements: tuple[int, ...]
    value: tuple[float, ...]


# Elements and values are those of gymnasium-robotics 1.4.2 (qpos minus the robot's nine).
GOALS: Mapping[str, Goal] = MappingProxyType(
    {
        "bottom burner": Goal(
            description="turn the knob of the bottom left burner",
            elements=(2, 3),
            value=(-0.88, -0.01),
        ),
        "top burner": Goal(
            description="turn the knob of the top left burner",
            elements=(6, 7),
            value=(-0.92, -0.01),
        ),
        "light switch": Goal(
            description="turn the light switch on the hood",
            elements=(8, 9),
            value=(-0.69, -0.05),
        ),
        "slide cabinet": Goal(
            description="slide the cabinet's door open to the right",
            elements=(10,),
            value=(0.37,),
        ),
        "hinge cabinet": Goal(
            description="open the right door of the hinge cabinet, the left one stays shut",
            elements=(11, 12),
            value=(0.0, 1.45),
        ),
        "microwave": Goal(
            description="open the microwave's door",
            elements=(13,),
            value=(-0.75,),
        ),
        "kettle": Goal(
            description="move the kettle to the top left burner",
            elements=(14, 15, 16, 17, 18, 19, 20),
            value=(-0.23, 0.75, 1.62, 0.99, 0.0, 0.0, -0.06),
        ),
    }
)


def goal_distances(achieved: NDArray, desired: NDArray, starts: Sequence[int] | NDArray) -> NDArray[np.float64]:
    """Euclidean distance of each task's values from its goal.

    Args:
      achieved: `(..., k)`, the values of all tasks one after the other.
      desired: `(..., k)`, the goals, likewise.
      starts: `(n,)`, where each task's values begin.

    Returns:
      `(..., n)` distances [rad, m].
    """
    return np.sqrt(np.add.reduceat(np.square(achieved - desired), starts, axis=-1))


class Progress(NamedTuple):
    """How far the tasks of an episode are after some control step.

    Attributes:
      step: `(..., 1)`, number of control steps made.
      within: `(..., n)`, whether each task is within its threshold.
      completions: `(..., n)`, whether each task was completed in this step; each that was pays a reward of 1.
      remaining: `(..., n)`, whether each task is still to be completed.
      completion_steps: `(..., n)`, control step at which each was first completed, -1 where it has not been.
    """

    step: NDArray[np.int64]
    within: NDArray[np.bool_]
    completions: NDArray[np.bool_]
    remaining: NDArray[np.bool_]
    completion_steps: NDArray[np.int64]

    @classmethod
    def initial(cls, shape: tuple[int, ...]) -> Self:
        """Before the first step; `shape` is `(..., n)`."""
        nothing = np.zeros(shape, bool)
        return cls(
            step=np.zeros((*shape[:-1], 1), np.int64),
            within=nothing,
            completions=nothing,
            remaining=np.ones(shape, bool),
            completion_steps=np.full(shape, -1),
        )

    def update(self, within: NDArray[np.bool_], *, remove_task_when_completed: bool) -> Self:
        """After one more step, at whose end the tasks are `within` their thresholds or not."""
        step = self.step + 1
        completions = within & self.remaining
        first = completions & (self.completion_steps < 0)
        remaining = self.remaining & ~completions if remove_task_when_completed else self.remaining
        return type(self)(step, within, completions, remaining, np.where(first, step, self.completion_steps))

    @property
    def reward(self) -> NDArray[np.float64]:
        """`(...)`, reward of the last step."""
        return np.add.reduce(self.completions, axis=-1, dtype=np.float64)

    @property
    def completed(self) -> NDArray[np.bool_]:
        """`(..., n)`, whether each task has been completed at some step."""
        return self.completion_steps > 0

    @property
    def all_completed(self) -> NDArray[np.bool_]:
        """`(...)`, whether all tasks have been."""
        return np.minimum.reduce(self.completion_steps, axis=-1) > 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalSet:
    """The tasks of an environment, with their goals laid end to end.

    Attributes:
      tasks: names in configured order, `n` of them.
      elements: `(k,)`, where the tasks' values stand in the 21 object positions.
      starts: `(n,)`, where each task's values begin among the `k`.
      desired: `(k,)`, the goals.
    """

    tasks: tuple[str, ...]
    elements: NDArray[np.int64]
    starts: NDArray[np.int64]
    desired: NDArray[np.float64]

    @classmethod
    def build(cls, tasks: Sequence[str], goals: Mapping[str, ArrayLike] | None = None) -> Self:
        """Collects the goals of some tasks.

        Args:
          tasks: names of tasks, spelt as in `GOALS`.
          goals: goals that replace those of `GOALS`, by task.

        Raises:
          TypeError: `tasks` is no sequence of strings, or a goal does not hold numbers.
          ValueError: `tasks` is empty, repeats a task or names an unknown one; a goal is for a task that is not among
            them, has the wrong length, or is not finite.
        """
        names = tuple(
            checks.choice(name, GOALS.keys(), "task") for name in checks.unique_names(tasks, "tasks_to_complete")
        )
        if goals is not None and not isinstance(goals, Mapping):
            raise TypeError(f"goals must map tasks to their goals, got {goals!r}")
        replaced = {checks.choice(name, names, "goal of task"): goal for name, goal in (goals or {}).items()}
        sizes = [len(GOALS[name].elements) for name in names]
        desired = [
            checks.vector(replaced.get(name, GOALS[name].value), size, f"goal of {name!r}")
            for name, size in zip(names, sizes, strict=True)
        ]
        return cls(
            tasks=names,
            elements=np.concatenate([GOALS[name].elements for name in names]),
            starts=np.cumsum([0, *sizes[:-1]]),
            desired=np.concatenate(desired),
        )

    def names(self, mask: NDArray[np.bool_]) -> list[str]:
        """Tasks that a mask `(n,)` chooses, in configured order."""
        return [task for task, chosen in zip(self.tasks, mask.tolist(), strict=True) if chosen]

    def by_completion(self, steps: NDArray[np.int64]) -> dict[str, int]:
        """The `completion_steps` `(n,)` of one episode by task, in order of completion."""
        done = ((task, step) for task, step in zip(self.tasks, steps.tolist(), strict=True) if step > 0)
        return dict(sorted(done, key=lambda item: item[1]))

    def split(self, flat: NDArray) -> dict[str, NDArray]:
        """Cuts goals laid end to end, `(..., k)`, into the tasks' own; the pieces are views."""
        return {task: flat[..., place] for task, place in self._places.items()}

    @functools.cached_property
    def _places(self) -> dict[str, slice]:
        """Where the tasks' values stand among all, by task."""
        stops = [*self.starts[1:], self.elements.size]
        return {task: slice(*place) for task, *place in zip(self.tasks, self.starts, stops, strict=True)}

    def distances(self, achieved: NDArray) -> NDArray[np.float64]:
        """Distances `(..., n)` of the tasks' values `(..., k)` from their goals."""
        return goal_distances(achieved, self.desired, self.starts)

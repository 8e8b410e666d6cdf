"""The seven goals of the kitchen, distances from them, and the completion of tasks.

The functions work on arrays of shape `(..., n)`: one environment has no leading axis, a batch has one or more.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks

# Distance below which a task counts as complete, over all joints of the task together [rad, m]; as in the reference.
THRESHOLD = 0.3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Goal:
    """Goal of one task.

    Attributes:
      description: the task in one line.
      joints: names of the joints that the goal is set for.
      elements: indices of these joints' positions among the 21 object positions of the observation.
      value: goal positions [rad, m; the kettle: m and a quaternion w, x, y, z].
    """

    description: str
    joints: tuple[str, ...]
    elements: tuple[int, ...]
    value: tuple[float, ...]


# Elements and values are those of gymnasium-robotics 1.4.2 (qpos minus the robot's nine).
GOALS: Mapping[str, Goal] = MappingProxyType(
    {
        "bottom burner": Goal(
            description="turn the knob of the bottom left burner",
            joints=("oven/knob_Joint_2", "oven/bottom_left_burner"),
            elements=(2, 3),
            value=(-0.88, -0.01),
        ),
        "top burner": Goal(
            description="turn the knob of the top left burner",
            joints=("oven/knob_Joint_4", "oven/top_left_burner"),
            elements=(6, 7),
            value=(-0.92, -0.01),
        ),
        "light switch": Goal(
            description="turn the light switch on the hood",
            joints=("hood/light_switch", "hood/light_joint"),
            elements=(8, 9),
            value=(-0.69, -0.05),
        ),
        "slide cabinet": Goal(
            description="slide the cabinet's door open to the right",
            joints=("slide_cabinet/slide_cabinet",),
            elements=(10,),
            value=(0.37,),
        ),
        "hinge cabinet": Goal(
            description="open the right door of the hinge cabinet, the left one stays shut",
            joints=("hinge_cabinet/left_hinge_cabinet", "hinge_cabinet/right_hinge_cabinet"),
            elements=(11, 12),
            value=(0.0, 1.45),
        ),
        "microwave": Goal(
            description="open the microwave's door",
            joints=("microwave/microwave",),
            elements=(13,),
            value=(-0.75,),
        ),
        "kettle": Goal(
            description="move the kettle to the top left burner",
            joints=("kettle/",),
            elements=(14, 15, 16, 17, 18, 19, 20),
            value=(-0.23, 0.75, 1.62, 0.99, 0.0, 0.0, -0.06),
        ),
    }
)


def goal_distances(achieved: NDArray, desired: NDArray, starts: Sequence[int] | NDArray) -> NDArray[np.float64]:
    """Returns the Euclidean distance of each task's values from its goal.

    Args:
      achieved: `(..., k)`, values of all tasks, end to end.
      desired: `(..., k)`, goals of all tasks, end to end.
      starts: `(n,)`, index of each task's first value among the `k`.

    Returns:
      `(..., n)` distances [rad, m].
    """
    return np.sqrt(np.add.reduceat(np.square(achieved - desired), starts, axis=-1))


class Progress(NamedTuple):
    """Completion of the tasks of an episode after a control step.

    Attributes:
      step: `(..., 1)`, number of control steps made.
      within: `(..., n)`, whether each task is within its threshold.
      completions: `(..., n)`, whether each task was completed in this step, which is rewarded with 1.
      remaining: `(..., n)`, whether each task is still to be completed.
      completion_steps: `(..., n)`, control step at which each task was first completed, -1 if it has not been.
    """

    step: NDArray[np.int64]
    within: NDArray[np.bool_]
    completions: NDArray[np.bool_]
    remaining: NDArray[np.bool_]
    completion_steps: NDArray[np.int64]

    @classmethod
    def initial(cls, shape: tuple[int, ...]) -> Self:
        """Returns the progress before the first step; `shape` is `(..., n)`."""
        none = np.zeros(shape, bool)
        return cls(
            step=np.zeros((*shape[:-1], 1), np.int64),
            within=none,
            completions=none,
            remaining=np.ones(shape, bool),
            completion_steps=np.full(shape, -1),
        )

    def update(self, within: NDArray[np.bool_], *, remove_task_when_completed: bool) -> Self:
        """Returns the progress after one more step, with the tasks then `within` `(..., n)` their thresholds."""
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
        """`(...)`, whether all tasks have been completed."""
        return np.minimum.reduce(self.completion_steps, axis=-1) > 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalSet:
    """The tasks of an environment, with their goals end to end.

    Attributes:
      tasks: names of the `n` tasks in configured order.
      elements: `(k,)`, indices of the tasks' values among the 21 object positions.
      starts: `(n,)`, index of each task's first value among the `k`.
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
          goals: goals that override those of `GOALS`, by task.

        Raises:
          TypeError: `tasks` is not a sequence of strings, or a goal does not hold numbers.
          ValueError: `tasks` is empty, repeats a task or names an unknown one; a goal is for a task that is not among
            them, has the wrong length, is not finite, or is greater than MuJoCo's greatest position.
        """
        names = tuple(
            checks.choice(name, GOALS.keys(), "task") for name in checks.unique_names(tasks, "tasks_to_complete")
        )
        if goals is not None and not isinstance(goals, Mapping):
            raise TypeError(f"goals must map tasks to their goals, got {goals!r}")
        overrides = {checks.choice(name, names, "goal of task"): goal for name, goal in (goals or {}).items()}
        sizes = [len(GOALS[name].elements) for name in names]
        desired = [
            checks.vector(overrides.get(name, GOALS[name].value), size, f"goal of {name!r}")
            for name, size in zip(names, sizes, strict=True)
        ]
        for name, goal in zip(names, desired, strict=True):
            if np.abs(goal).max() > mujoco.mjMAXVAL:
                limit = f"{mujoco.mjMAXVAL:g}, the greatest position that MuJoCo simulates"
                raise ValueError(f"goal of {name!r} must not exceed {limit}, got {goal}")
        return cls(
            tasks=names,
            elements=np.concatenate([GOALS[name].elements for name in names]),
            starts=np.cumsum([0, *sizes[:-1]]),
            desired=np.concatenate(desired),
        )

    def names(self, mask: NDArray[np.bool_]) -> list[str]:
        """Returns the tasks selected by a mask `(n,)`, in configured order."""
        return [task for task, selected in zip(self.tasks, mask.tolist(), strict=True) if selected]

    def by_completion(self, steps: NDArray[np.int64]) -> dict[str, int]:
        """Returns the `completion_steps` `(n,)` of one episode by task, in order of completion."""
        done = ((task, step) for task, step in zip(self.tasks, steps.tolist(), strict=True) if step > 0)
        return dict(sorted(done, key=lambda item: item[1]))

    def split(self, flat: NDArray) -> dict[str, NDArray]:
        """Returns views of goals end to end, `(..., k)`, by task."""
        return {task: flat[..., indices] for task, indices in self._slices.items()}

    @functools.cached_property
    def _slices(self) -> dict[str, slice]:
        """Slice of each task's values among the `k`."""
        stops = [*self.starts[1:], self.elements.size]
        return {task: slice(start, stop) for task, start, stop in zip(self.tasks, self.starts, stops, strict=True)}

    def distances(self, achieved: NDArray) -> NDArray[np.float64]:
        """Returns distances `(..., n)` of the tasks' values `(..., k)` from their goals."""
        return goal_distances(achieved, self.desired, self.starts)

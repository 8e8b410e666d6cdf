"""Goals of objects, distances from them, and the completion of tasks.

The functions work on arrays of shape `(..., n)`: one environment has no leading axis, a batch has one or more.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.instructions import checked, joined


@dataclasses.dataclass(frozen=True, kw_only=True)
class Goal:
    """Goal positions of a prop's joints, in any scene with a prop of that name.

    Attributes:
      prop: name of the prop.
      joints: names of the joints in the prop's own model; None for all of its joints.
      value: goal positions, joint by joint [rad, m; a free joint: m and a quaternion w, x, y, z].
      start: positions of these joints at the start of an episode; those of the scene's initial state when None.
      instructions: the task in words, a sentence and paraphrases of it; see `tasks.instructions`.
      handle: name of the prop's site at which the robot moves it; the first of its handles when None.
    """

    prop: str
    joints: tuple[str, ...] | None = None
    value: tuple[float, ...]
    start: tuple[float, ...] | None = None
    instructions: tuple[str, ...] = ()
    handle: str | None = None

    def __post_init__(self) -> None:
        """Checks the instructions; raises as `instructions.checked`."""
        checked(self.instructions, f"a goal of prop {self.prop!r}")

    def joints_in(self, scene: Scene) -> tuple[mjcf.Element, ...]:
        """Returns the joints that the goal is set for.

        Raises:
          ValueError: the scene has no such prop, or its prop no such joint.
        """
        return scene.joints(self.prop, self.joints)

    def shares_joints(self, other: Self) -> bool:
        """Whether another goal is set for one of the same joints."""
        if self.joints is None or other.joints is None:
            return self.prop == other.prop
        return self.prop == other.prop and not set(self.joints).isdisjoint(other.joints)

    def handle_in(self, scene: Scene) -> mjcf.Element:
        """Returns the site at which the robot moves the prop.

        Raises:
          ValueError: the scene has no such prop, or its prop no such site.
        """
        handles = {site.name: site for site in scene.props[checks.choice(self.prop, scene.props, "prop")].handles}
        return handles[checks.choice(self.handle or next(iter(handles), ""), handles, f"handle of {self.prop!r}")]

    def elements_in(self, scene: Scene) -> NDArray[np.int64]:
        """Returns the indices `(k,)` of these joints' positions among the scene's object positions."""
        return scene.elements(self.prop, self.joints)


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
    def completed(self) -> NDArray[np.bool_]:
        """`(..., n)`, whether each task has been completed at some step."""
        return self.completion_steps > 0

    @property
    def advanced(self) -> NDArray[np.bool_]:
        """`(...)`, whether a task has been completed for the first time in this step."""
        return np.logical_or.reduce((self.completion_steps == self.step) & self.completed, axis=-1)

    @property
    def steps_since_completion(self) -> NDArray[np.int64]:
        """`(...)`, control steps since a task was completed for the first time, or since the reset."""
        last = np.maximum.reduce(self.completion_steps, axis=-1, initial=0)
        return self.step[..., 0] - last

    @property
    def all_completed(self) -> NDArray[np.bool_]:
        """`(...)`, whether all tasks have been completed."""
        return np.minimum.reduce(self.completion_steps, axis=-1) > 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalSet:
    """The tasks of an environment, with their goals end to end.

    Attributes:
      tasks: names of the `n` tasks in configured order.
      goals: goal of each task; `desired` has the values.
      starts: `(n,)`, index of each task's first value among the `k`.
      desired: `(k,)`, the goals.
    """

    tasks: tuple[str, ...]
    goals: tuple[Goal, ...]
    starts: NDArray[np.int64]
    desired: NDArray[np.float64]

    @classmethod
    def build(
        cls, known: Mapping[str, Goal], tasks: Sequence[str], values: Mapping[str, ArrayLike] | None = None
    ) -> Self:
        """Collects the goals of some tasks.

        Args:
          known: goals by task.
          tasks: names of tasks among `known`.
          values: goal positions that override those of `known`, by task.

        Raises:
          TypeError: `tasks` is not a sequence of strings, or a value does not hold numbers.
          ValueError: `tasks` is empty, repeats a task or names an unknown one; a value is for a task that is not among
            them, has the wrong length, is not finite, or is greater than MuJoCo's greatest position.
        """
        names = tuple(
            checks.choice(name, known.keys(), "task") for name in checks.unique_names(tasks, "tasks_to_complete")
        )
        if values is not None and not isinstance(values, Mapping):
            raise TypeError(f"goals must map tasks to their goals, got {values!r}")
        overrides = {checks.choice(name, names, "goal of task"): value for name, value in (values or {}).items()}
        goals = tuple(known[name] for name in names)
        sizes = [len(goal.value) for goal in goals]
        desired = [
            checks.vector(overrides.get(name, goal.value), len(goal.value), f"goal of {name!r}")
            for name, goal in zip(names, goals, strict=True)
        ]
        for name, value in zip(names, desired, strict=True):
            if np.abs(value).max() > mujoco.mjMAXVAL:
                limit = f"{mujoco.mjMAXVAL:g}, the greatest position that MuJoCo simulates"
                raise ValueError(f"goal of {name!r} must not exceed {limit}, got {value}")
        return cls(
            tasks=names,
            goals=goals,
            starts=np.cumsum([0, *sizes[:-1]]),
            desired=np.concatenate(desired),
        )

    @functools.cached_property
    def instructions(self) -> tuple[str, ...]:
        """Instructions of all tasks together, in configured order; see `instructions.joined`."""
        return joined(goal.instructions for goal in self.goals)

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
        stops = [*self.starts[1:], self.desired.size]
        return {task: slice(start, stop) for task, start, stop in zip(self.tasks, self.starts, stops, strict=True)}

    def distances(self, achieved: NDArray, desired: NDArray | None = None) -> NDArray[np.float64]:
        """Returns distances `(..., n)` of the tasks' values `(..., k)` from their goals, or from others `(..., k)`."""
        return goal_distances(achieved, self.desired if desired is None else desired, self.starts)

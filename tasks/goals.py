"""Goals of objects: in numbers and in words, distances from them, success, and the completion of tasks.

The instructions of a task are a tuple of strings: first the task's sentence, then paraphrases of it. They are commands
in lower case without a full stop. A task without a sentence has the empty tuple.

The functions work on arrays of shape `(..., n)`: one environment has no leading axis, a batch has one or more.
"""

import abc
import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, Self

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.joints import joint_types
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.terms import end_to_end

# Names of the criteria, the default first.
CRITERIA = ("original", "strict")

# Tolerances of `strict`.
JOINT_TOLERANCES = {"hinge": 0.05, "slide": 0.01}  # Of a joint [rad, m].
POSITION_TOLERANCE = 0.03  # Of a free object's position [m].
_TILT_TOLERANCE = 0.2  # Of a free object's tilt [rad].

Thresholds = float | Mapping[str, float]

# Between the sentences of several tasks.
_SEPARATOR = ", then "

# The same goal in every scene that has the microwave.
OPEN_MICROWAVE = (
    "open the microwave door",
    "open the microwave",
    "pull the door of the microwave open",
    "swing the microwave door open",
)


def checked_instructions(instructions: object, owner: str) -> tuple[str, ...]:
    """Returns instructions if they are a tuple of strings that are not empty; `owner` is for messages."""
    if not isinstance(instructions, tuple) or not all(isinstance(each, str) for each in instructions):
        raise TypeError(f"instructions of {owner} must be a tuple of strings, got {checks.shown(instructions)}")
    if not all(each.strip() for each in instructions):
        raise ValueError(f"instructions of {owner} must not be empty strings, got {checks.shown(instructions)}")
    return instructions


@dataclasses.dataclass(frozen=True, kw_only=True)
class Goal:
    """Goal positions of a prop's joints, in any scene with a prop of that name.

    Attributes:
      prop: name of the prop.
      joints: names of the joints in the prop's own model; None for all of its joints.
      value: goal positions, joint by joint [rad, m; a free joint: m and a quaternion w, x, y, z].
      start: positions of these joints at the start of an episode; those of the scene's initial state when None.
      instructions: the task in words, a sentence and paraphrases of it.
      handle: name of the prop's site at which the robot moves it; the first of its handles when None.
    """

    prop: str
    joints: tuple[str, ...] | None = None
    value: tuple[float, ...]
    start: tuple[float, ...] | None = None
    instructions: tuple[str, ...] = ()
    handle: str | None = None

    def __post_init__(self) -> None:
        checked_instructions(self.instructions, f"a goal of prop {self.prop!r}")

    def joints_in(self, scene: Scene) -> tuple[mjcf.Element, ...]:
        """Returns the joints that the goal is set for; raises a ValueError if the scene lacks one."""
        return scene.joints(self.prop, self.joints)

    def geoms_in(self, scene: Scene) -> list[mjcf.Element]:
        """Returns the geoms that move with these joints."""
        return [geom for joint in self.joints_in(scene) for geom in joint.parent.find_all("geom")]

    def shares_joints(self, other: Self) -> bool:
        """Whether another goal is set for one of the same joints."""
        if self.joints is None or other.joints is None:
            return self.prop == other.prop
        return self.prop == other.prop and not set(self.joints).isdisjoint(other.joints)

    def handle_in(self, scene: Scene) -> mjcf.Element:
        """Returns the site at which the robot moves the prop; raises a ValueError if the scene lacks it."""
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

    @classmethod
    def of_request(cls, order: NDArray[np.int64]) -> Self:
        """Returns the progress before the first step of an episode that asks for tasks in an order `(..., n)`."""
        return cls.initial(order.shape)._replace(remaining=order >= 0)

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
        return self.step[..., 0] - np.maximum.reduce(self.completion_steps, axis=-1, initial=0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalSet:
    """The tasks of an environment, with their goals end to end.

    Attributes:
      tasks: names of the `n` tasks in configured order.
      goals: goal of each task; `desired` has the values.
      first_elements: `(n,)`, index of each task's first value among the `k`.
      desired: `(k,)`, the goals.
    """

    tasks: tuple[str, ...]
    goals: tuple[Goal, ...]
    first_elements: NDArray[np.int64]
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
          ValueError: `tasks` is empty, repeats a task or names an unknown one; a value is for a task that is not among
            them, has the wrong length, is not finite, or is greater than MuJoCo's greatest position.
        """
        unique = checks.unique_names(tasks, "tasks_to_complete")
        names = tuple(checks.choice(name, known.keys(), "task") for name in unique)
        if values is not None and not isinstance(values, Mapping):
            raise TypeError(f"goals must map tasks to their goals, got {checks.shown(values)}")
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
                raise ValueError(f"goal of {name!r} must not exceed {limit}, got {checks.shown(value)}")
        return cls(
            tasks=names, goals=goals, first_elements=np.cumsum([0, *sizes[:-1]]), desired=np.concatenate(desired)
        )

    def instructions(self, indices: Iterable[int]) -> tuple[str, ...]:
        """Returns the instructions of several tasks together, in a given order.

        The first joins the sentences, the next ones the first paraphrases, the second paraphrases and so on, as many as
        every task has. Empty if a task has none.
        """
        each = (self.goals[index].instructions for index in indices)
        return tuple(_SEPARATOR.join(sentences) for sentences in zip(*each, strict=False))

    def names(self, mask: NDArray[np.bool_]) -> list[str]:
        """Returns the tasks selected by a mask `(n,)`, in configured order."""
        return [task for task, selected in zip(self.tasks, mask.tolist(), strict=True) if selected]

    def by_completion(self, steps: NDArray[np.int64]) -> dict[str, int]:
        """Returns the `completion_steps` `(n,)` of one episode by task, in order of completion."""
        done = ((task, step) for task, step in zip(self.tasks, steps.tolist(), strict=True) if step > 0)
        return dict(sorted(done, key=lambda item: item[1]))

    def split(self, flat: NDArray) -> dict[str, NDArray]:
        """Returns views of goals end to end, `(..., k)`, by task."""
        return {task: flat[..., indices] for task, indices in self.slices.items()}

    @functools.cached_property
    def slices(self) -> Mapping[str, slice]:
        """Slice of each task's values among the `k`."""
        sizes = np.diff([*self.first_elements, self.desired.size]).tolist()
        return end_to_end(dict(zip(self.tasks, sizes, strict=True)))

    def distances(self, achieved: NDArray, desired: NDArray | None = None) -> NDArray[np.float64]:
        """Returns distances `(..., n)` of the tasks' values `(..., k)` from their goals, or from others `(..., k)`."""
        return goal_distances(achieved, self.desired if desired is None else desired, self.first_elements)


class Success(abc.ABC):
    """Decides which tasks are complete.

    Attributes:
      goals: the tasks, with their goals.
    """

    def __init__(self, goals: GoalSet) -> None:
        self.goals = goals

    @abc.abstractmethod
    def ratios(self, achieved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the distance of each task from its goal as a fraction of what completion allows, `(..., n)`."""

    @abc.abstractmethod
    def within(
        self, achieved: NDArray[np.float64], desired: NDArray[np.float64] | None = None, factor: float = 1.0
    ) -> NDArray[np.bool_]:
        """Returns whether `(..., n)` each task is complete.

        Args:
          achieved: `(..., k)`, positions of the goals' joints, end to end.
          desired: `(..., k)`, the goals, where they are not those of the tasks.
          factor: by which thresholds or tolerances are greater.
        """

    def within_distances(self, distances: NDArray[np.float64]) -> NDArray[np.bool_] | None:
        """Returns whether `(..., n)` tasks at some distances from their goals are complete; None if that needs more."""
        return None


class ThresholdSuccess(Success):
    """Complete is a task whose distance from its goal, over all of its joints together, is below a threshold.

    Attributes:
      thresholds: of all tasks, or `(n,)` [rad, m].
    """

    def __init__(self, goals: GoalSet, thresholds: float | NDArray[np.float64]) -> None:
        super().__init__(goals)
        self.thresholds = thresholds

    def ratios(self, achieved: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.goals.distances(achieved) / self.thresholds

    def within(
        self, achieved: NDArray[np.float64], desired: NDArray[np.float64] | None = None, factor: float = 1.0
    ) -> NDArray[np.bool_]:
        return self.goals.distances(achieved, desired) < factor * self.thresholds

    def within_distances(self, distances: NDArray[np.float64]) -> NDArray[np.bool_]:
        return distances < self.thresholds


class StrictSuccess(Success):
    """Complete is a task all of whose joints are within their tolerances of the goal.

    A hinge must be within 0.05 rad and a slide within 0.01 m. A free object must be within 3 cm, and its vertical
    within 0.2 rad of the goal's; it may be turned about the vertical.
    """

    def __init__(self, goals: GoalSet, scene: Scene) -> None:
        """Looks up the types of the goals' joints in a scene."""
        super().__init__(goals)
        types = [joint_types(goal.joints_in(scene)) for goal in goals.goals]
        self._free = [number for number, each in enumerate(types) if each == ["free"]]
        # Positions of free objects have a tolerance of their own.
        tolerances = [[np.inf] * 7 if each == ["free"] else [JOINT_TOLERANCES[kind] for kind in each] for each in types]
        self._tolerances = np.array([tolerance for each in tolerances for tolerance in each])

    def within(
        self, achieved: NDArray[np.float64], desired: NDArray[np.float64] | None = None, factor: float = 1.0
    ) -> NDArray[np.bool_]:
        return self.ratios(achieved, desired) <= factor

    def ratios(self, achieved: NDArray[np.float64], desired: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        desired = self.goals.desired if desired is None else desired
        errors = np.abs(achieved - desired) / self._tolerances
        ratios: NDArray[np.float64] = np.maximum.reduceat(errors, self.goals.first_elements, axis=-1)
        for number in self._free:
            start = self.goals.first_elements[number]
            ratios[..., number] = _pose_ratio(achieved[..., start : start + 7], desired[..., start : start + 7])
        return ratios


def _pose_ratio(pose: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the greater of the distances `(...)` of poses in position and in tilt, in units of their tolerances."""
    position = goal_distances(pose[..., :3], goal[..., :3], (0,))[..., 0]
    # The chord between the verticals, twice the sine of half their angle; quaternions may be of any length but 0.
    with np.errstate(invalid="ignore", divide="ignore"):
        chord = goal_distances(_vertical(pose[..., 3:]), _vertical(goal[..., 3:]), (0,))[..., 0]
    return np.maximum(position / POSITION_TOLERANCE, chord / (2.0 * np.sin(_TILT_TOLERANCE / 2.0)))


def _vertical(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the vertical axis `(..., 3)` of an object with an orientation `(..., 4)`."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    axis = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=-1)
    return axis / (w * w + x * x + y * y + z * z)[..., np.newaxis]


def make_success(
    goals: GoalSet,
    scene: Scene,
    *,
    default: float,
    success: str | None = None,
    threshold: Thresholds | None = None,
    positive: bool = False,
) -> Success:
    """Builds what decides completion.

    Args:
      goals: the tasks, with their goals.
      scene: with the goals' props.
      default: threshold where none is given [rad, m].
      success: `original`, with thresholds, or `strict`; see `StrictSuccess`.
      threshold: distance from the goal below which a task is complete, of all tasks or by task [rad, m]; not together
        with `success`.
      positive: whether a threshold of 0 is refused.
    """
    if success is not None and threshold is not None:
        given = f"threshold={checks.shown(threshold)} and success={checks.shown(success)}"
        raise ValueError(f"{given} exclude each other: give one of them")
    if success is not None and checks.choice(success, CRITERIA, "success") == "strict":
        return StrictSuccess(goals, scene)
    if not isinstance(threshold, Mapping):
        one = default if threshold is None else threshold
        return ThresholdSuccess(goals, checks.number(one, "threshold", positive=positive))
    by_task = {checks.choice(task, goals.tasks, "threshold of task"): value for task, value in threshold.items()}
    each = (
        checks.number(by_task.get(task, default), f"threshold of {task!r}", positive=positive) for task in goals.tasks
    )
    return ThresholdSuccess(goals, np.array([*each]))

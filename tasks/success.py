"""When a task counts as complete: within a threshold of its goal, or with every joint within a strict tolerance."""

import abc
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.joints import joint_types
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.goals import GoalSet, goal_distances

# Names of the criteria, the default first.
CRITERIA = ("original", "strict")

# Tolerances of `strict`: of a joint [rad, m], and of a free object's position [m] and tilt [rad].
_JOINT_TOLERANCES = {"hinge": 0.05, "slide": 0.01}
_POSITION_TOLERANCE, _TILT_TOLERANCE = 0.03, 0.2

Thresholds = float | Mapping[str, float]


class Success(abc.ABC):
    """Decides which tasks are complete.

    Attributes:
      goals: the tasks, with their goals.
    """

    def __init__(self, goals: GoalSet) -> None:
        self.goals = goals

    @abc.abstractmethod
    def ratios(self, achieved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the distances `(..., n)` of achieved goals `(..., k)` from completion, which has those up to 1."""

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
        tolerances = [
            [np.inf] * 7 if each == ["free"] else [_JOINT_TOLERANCES[kind] for kind in each] for each in types
        ]
        self._tolerances = np.array([tolerance for each in tolerances for tolerance in each])

    def within(
        self, achieved: NDArray[np.float64], desired: NDArray[np.float64] | None = None, factor: float = 1.0
    ) -> NDArray[np.bool_]:
        return self.ratios(achieved, desired) <= factor

    def ratios(self, achieved: NDArray[np.float64], desired: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        desired = self.goals.desired if desired is None else desired
        errors = np.abs(achieved - desired) / self._tolerances
        ratios: NDArray[np.float64] = np.maximum.reduceat(errors, self.goals.starts, axis=-1)
        for number in self._free:
            start = self.goals.starts[number]
            ratios[..., number] = _pose_ratio(achieved[..., start : start + 7], desired[..., start : start + 7])
        return ratios


def _pose_ratio(pose: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the greater of the distances `(...)` of poses in position and in tilt, in units of their tolerances."""
    position = goal_distances(pose[..., :3], goal[..., :3], (0,))[..., 0]
    # The chord between the verticals, twice the sine of half their angle; quaternions may be of any length but 0.
    with np.errstate(invalid="ignore", divide="ignore"):
        chord = goal_distances(_vertical(pose[..., 3:]), _vertical(goal[..., 3:]), (0,))[..., 0]
    return np.maximum(position / _POSITION_TOLERANCE, chord / (2.0 * np.sin(_TILT_TOLERANCE / 2.0)))


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

    Raises:
      TypeError: an argument of the wrong type.
      ValueError: an unknown name, a threshold that is negative or not finite, or both arguments.
    """
    if success is not None and threshold is not None:
        raise ValueError(f"threshold={threshold!r} and success={success!r} exclude each other: give one of them")
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

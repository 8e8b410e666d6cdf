"""The kitchen's expert, which completes tasks one after the other."""

import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Self

import mink
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.policies.experts import kitchen_skills
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import make_encoder
from kitchen_suite.policies.experts.kinematics import ARM
from kitchen_suite.policies.experts.kitchen_layout import (
    ObservedLayout,
    achieved,
    arm_model,
    needed_observables,
    requested_in,
    scene,
)
from kitchen_suite.policies.experts.kitchen_skills import FIXED_SKILLS, SKILLS, STRICT_SKILLS, left_door_skill
from kitchen_suite.policies.experts.skills import OPEN, HandOrientation, Move, Skill
from kitchen_suite.policies.experts.trajectories import (
    OUT_OF_REACH,
    JointSpeedLimits,
    JointTrajectory,
    plan,
    plan_retreat,
)
from kitchen_suite.tasks.control_modes.modes import make_mode
from kitchen_suite.tasks.goals import StrictSuccess, Thresholds, make_success
from kitchen_suite.tasks.kitchen.action import CONTROL_MODES
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS, THRESHOLD, build_goals
from kitchen_suite.tasks.kitchen.observation import AMPLITUDES, SLICES
from kitchen_suite.tasks.kitchen.task import KitchenTask

# A completed task is repeated if its distance grows beyond this multiple of the threshold; doors spring back a little.
_UNDONE = 1.2

# A task is done when its distance is below this fraction of the threshold; noise may make the distance look smaller
# than it is.
_DONE = 0.98
# With strict tolerances: distance from the goal, in tolerances, below which objects are moved more slowly, and the
# least share of the speed.
_SLOW_DISTANCE, _LEAST_PACE = 8.0, 0.12
# Control steps from the end of a trajectory to the failure of its task: an object that is pushed lags behind the hand.
_SETTLE_STEPS = 6

# Trajectories are shared by object positions that are equal to this number of decimals [rad, m].
_DECIMALS = 2

# Angles by which the hand is turned about the vertical until the poses of a skill are in reach [rad].
_TURNS = (0.0, -0.12, -0.24, 0.12, 0.24)

# Share of the arc of a door with which its task is completed.
_ENOUGH_OF_ARC = 0.8

_ROBOT = SLICES[0]
_SIZE = AMPLITUDES.size

# Joint positions in free space from which the arm starts again after a failure [rad].
_HOME = INITIAL_QPOS[ARM]


class TaskQueue:
    """Tasks that remain to be done; the first one is the current one.

    Distances are by task, in units of its threshold.

    Attributes:
      tasks: all tasks, in the order in which they were to be done.
    """

    def __init__(self, tasks: Sequence[str]) -> None:
        self.tasks = tuple(tasks)
        self._remaining = list(tasks)

    @property
    def size(self) -> int:
        """Number of tasks that remain."""
        return len(self._remaining)

    @property
    def current(self) -> str | None:
        """The task under way; None when all are done."""
        return self._remaining[0] if self._remaining else None

    def complete(self) -> None:
        """Removes the current task."""
        del self._remaining[0]

    def postpone(self) -> None:
        """Moves the current task behind the others."""
        self._remaining.append(self._remaining.pop(0))

    def restart_undone(self, distances: Mapping[str, float]) -> None:
        """Adds the completed tasks that have come undone, once no others remain."""
        self._remaining = [task for task in self.tasks if distances[task] > _UNDONE]


class KitchenExpert(Expert):
    """Completes tasks of the kitchen one after the other, and repeats a failed task after the others."""

    control_modes = CONTROL_MODES
    observation_size = _SIZE

    def __init__(
        self,
        tasks: Sequence[str],
        *,
        threshold: Thresholds | None = None,
        success: str | None = None,
        goals: Mapping[str, ArrayLike] | None = None,
        in_order: bool = False,
        style: MotionStyle | None = None,
        control_mode: str = "joint_velocity",
        extra_observables: Sequence[str] = (),
        observes_requests: bool = False,
        **control_options: Any,
    ) -> None:
        """Builds an expert for a set of tasks.

        Args:
          tasks: names of the tasks, spelt as in `tasks.GOALS`.
          threshold: distance from its goal below which a task is done, of all tasks or by task [rad, m]; if it is below
            the environment's, the expert moves on later than necessary. 0.3 when omitted.
          success: the environment's: `original`, by the threshold, or `strict`. Not together with `threshold`.
          goals: goals that replace the usual ones, by task. The motions stay the same; they stop at the goal.
          in_order: whether to do the tasks in the given order; otherwise in one with short motions between them.
          style: speed, noise and jitter of the motions.
          control_mode: the environment's.
          extra_observables: the environment's. If they include poses, such as `microwave/pose` or `franka/base_pose`,
            the observation must include all of them, and the motions are planned for the poses.
          observes_requests: whether the observation ends with `requested_tasks`, which the expert then does. Of several
            at once it cannot observe the order: with `in_order` it does them in that of `tasks`. It turns to other
            tasks when others are asked, as with the environment's `tasks_in_turn`.
          **control_options: arguments of the control mode: the environment's.
        """
        self._goals = build_goals(tasks, goals)
        self._success = make_success(
            self._goals, scene(), default=THRESHOLD, success=success, threshold=threshold, positive=True
        )
        order = tuple(tasks) if checks.boolean(in_order, "in_order") else tuple(SKILLS)
        self._order = tuple(task for task in order if task in self._goals.tasks)
        encoder = make_encoder(make_mode(control_mode, CONTROL_MODES, control_options), arm_model())
        self._layout = ObservedLayout(extra_observables)
        self.observed_extras = self._layout.slices
        self._num_requests = len(self._goals.tasks) if checks.boolean(observes_requests, "observes_requests") else 0
        self.observation_size = _SIZE + self._layout.size + self._num_requests
        self._is_strict = isinstance(self._success, StrictSuccess)
        precise = STRICT_SKILLS if self._is_strict else SKILLS
        self._skills = precise if encoder.turns_hand else FIXED_SKILLS
        self._limits, self._kinematics = encoder.limits, arm_model().kinematics
        super().__init__(style, encoder)

    @classmethod
    def for_task(cls, task: KitchenTask, **options: Any) -> Self:
        if "threshold" in options or "success" in options:
            options = {**dict.fromkeys(task.success_options), **options}
        return super().for_task(task, **options)

    @classmethod
    def _task_settings(cls, task: KitchenTask) -> dict[str, Any]:
        return {
            "tasks": task.mdp.goals.tasks,
            "goals": task.goals,
            **task.success_options,
            "extra_observables": tuple(task.extra_observables),
            "observes_requests": task.mdp.task_draw is not None,
        }

    def without_goals(self, flat: NDArray) -> NDArray:
        count = self._num_requests
        return np.concatenate([flat[: self.observation_size - count], flat[flat.size - count :]])

    def _needed_observables(self, varied: Collection[str]) -> list[str]:
        return needed_observables(self._goals.tasks, varied)

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self._queue = TaskQueue(self._order)

    def _robot_positions(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        return observation[_ROBOT]

    def _next_trajectory(self, observation: NDArray[np.float64], joints: NDArray[np.float64]) -> JointTrajectory | None:
        requested = self._requested(observation)
        if self._trajectory is None:
            self._queue = TaskQueue(requested)
            return self._then_current_task(JointTrajectory.stationary(joints, OPEN), observation)
        if requested != self._queue.tasks:
            return self._turn_to(requested, observation, joints)
        distances, task = self._relative_distances(observation), self._queue.current
        if self._is_strict:
            self._pace = _pace(distances[task]) if task else 1.0
        if task is None:
            return self._resume_from_rest(distances, observation, joints)
        if distances[task] < _DONE:
            retreat = self._plan_retreat(self._skill, joints)
            self._queue.complete()
            return self._then_current_task(retreat, observation)
        if self._has_ended(_SETTLE_STEPS):
            home = JointTrajectory.stationary(_HOME, OPEN)
            retreat = self._plan_retreat(self._skill, joints).then(home, self._limits)
            self._queue.postpone()
            return self._then_current_task(retreat, observation)
        return None

    def _requested(self, observation: NDArray[np.float64]) -> tuple[str, ...]:
        """Returns the tasks that an observation asks for, in the order in which to do them."""
        count = self._num_requests
        return requested_in(self._order, self._goals.tasks, observation[-count:]) if count else self._order

    def _turn_to(
        self, tasks: Sequence[str], observation: NDArray[np.float64], joints: NDArray[np.float64]
    ) -> JointTrajectory:
        """Leaves what is under way for other tasks."""
        is_busy = self._queue.current is not None
        retreat = self._plan_retreat(self._skill, joints) if is_busy else JointTrajectory.stationary(joints, OPEN)
        self._queue = TaskQueue(tasks)
        return self._then_current_task(retreat, observation)

    def _resume_from_rest(
        self, distances: Mapping[str, float], observation: NDArray[np.float64], joints: NDArray[np.float64]
    ) -> JointTrajectory | None:
        """Starts on tasks that have come undone, if there are any, once the last retreat has ended."""
        if not self._has_ended(_SETTLE_STEPS):
            return None
        self._queue.restart_undone(distances)
        if self._queue.current is None:
            return None
        return self._then_current_task(JointTrajectory.stationary(joints, OPEN), observation)

    def _relative_distances(self, observation: NDArray[np.float64]) -> dict[str, float]:
        """Distances of the objects from the tasks' goals, in units of the threshold or tolerance."""
        positions = np.concatenate([achieved(task, observation) for task in self._goals.tasks])
        return dict(zip(self._goals.tasks, self._success.ratios(positions).tolist(), strict=True))

    def _then_current_task(self, trajectory: JointTrajectory, observation: NDArray[np.float64]) -> JointTrajectory:
        """Appends the trajectory of the queue's current task, if there is one; postpones tasks that are out of reach.

        If all tasks are out of reach, the first one is tried.
        """
        for _ in range(self._queue.size):
            planned = self._plan(observation)
            if not self._layout.slices or _is_reachable(planned):
                return trajectory.then(planned, self._limits)
            self._queue.postpone()
        return trajectory.then(self._plan(observation), self._limits) if self._queue.current else trajectory

    def _plan_retreat(self, skill: Skill, joints: NDArray[np.float64]) -> JointTrajectory:
        return plan_retreat(self._kinematics, self._limits, skill, joints=joints, fingers=self._current_fingers)

    def _plan(self, observation: NDArray[np.float64]) -> JointTrajectory:
        """Chooses and plans a skill for the current task, for the present positions of the joints of its goal."""
        task = self._queue.current
        assert task is not None, "there is a task under way"
        positions, frame = achieved(task, observation), self._layout.frame(task, observation[_SIZE:])
        skill = self._skill = self._choose_skill(task, observation, frame)
        position = positions[list(skill.object_joint.elements)] if skill.object_joint else None
        if frame is not None:
            return self._plan_in_frame(skill, position, frame)
        if self._style.jitter:
            return self._plan_skill(skill, position, None)
        rounded = None if position is None else tuple(position.round(_DECIMALS).tolist())
        return _cached_plan(skill, rounded, self._limits)

    def _plan_in_frame(self, skill: Skill, position: NDArray[np.float64] | None, frame: mink.SE3) -> JointTrajectory:
        """Plans a skill in a frame; the hand is turned a little where its poses are out of reach."""
        best = None
        for turn in _TURNS if self._encoder.turns_hand else _TURNS[:1]:
            planned = self._plan_skill(skill.turned(turn) if turn else skill, position, frame)
            if _is_reachable(planned) and planned.arc_share >= _ENOUGH_OF_ARC:
                return planned
            if best is None or (_is_reachable(planned), planned.arc_share) > (_is_reachable(best), best.arc_share):
                best = planned
        assert best is not None, "there is at least one turn"
        return best

    def _plan_skill(
        self, skill: Skill, position: NDArray[np.float64] | None, frame: mink.SE3 | None
    ) -> JointTrajectory:
        offsets = self._draw_offsets(sum(isinstance(move, Move) and move.in_free_space for move in skill.moves))
        return plan(self._kinematics, self._limits, skill, frame=frame, object_position=position, offsets=offsets)

    def _choose_skill(self, task: str, observation: NDArray[np.float64], frame: mink.SE3 | None) -> Skill:
        skill = self._skills[task]
        if task == "kettle":
            skill = kitchen_skills.kettle_skill(achieved(task, observation)[:3]) or skill
        if task == "slide cabinet":
            _, door = achieved("hinge cabinet", observation)
            skill = kitchen_skills.slide_skill_beside_door(skill, door) or skill
        if task == "left hinge cabinet":
            skill = left_door_skill(*achieved(task, observation)) or skill
        if frame is None or self._encoder.turns_hand:
            return skill
        rotation = frame.rotation().inverse() @ kitchen_skills.AT_RESET.rotation
        return skill.with_orientation(HandOrientation.from_rotation(rotation))


def _pace(distance: float) -> float:
    """Returns the share of the speed at which an object is moved at a distance from its goal, in units of tolerance."""
    return min(max((distance - 1.0) / _SLOW_DISTANCE, _LEAST_PACE), 1.0)


def _is_reachable(trajectory: JointTrajectory) -> bool:
    return trajectory.position_error <= OUT_OF_REACH


@functools.lru_cache(maxsize=1024)
def _cached_plan(skill: Skill, object_position: tuple[float, ...] | None, limits: JointSpeedLimits) -> JointTrajectory:
    """Trajectory of a skill without jitter; cached, as it is the same in nearly all episodes."""
    position = None if object_position is None else np.array(object_position)
    return plan(arm_model().kinematics, limits, skill, object_position=position)

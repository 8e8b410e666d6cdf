"""The kitchen's expert, which completes tasks one after the other, also where furniture and robot stand elsewhere."""

import collections
import dataclasses
import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Self

import mink
import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities import KitchenArena, Scene, build_kitchen_scene
from kitchen_suite.entities.arms import FRANKA, robot_spec
from kitchen_suite.entities.arms.franka import KITCHEN_FRANKA
from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.robot import RobotSpec
from kitchen_suite.policies.experts import kitchen_skills
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.encoders import ArmModel, make_encoder
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.kitchen_skills import FIXED_SKILLS, SKILLS, STRICT_SKILLS
from kitchen_suite.policies.experts.skills import OPEN, HandOrientation, Skill
from kitchen_suite.policies.experts.trajectories import OUT_OF_REACH, JointSpeedLimits, JointTrajectory, plan
from kitchen_suite.tasks.control_modes.registry import make_mode
from kitchen_suite.tasks.episode import extra_observables
from kitchen_suite.tasks.goals import GoalSet, StrictSuccess, Thresholds, make_success
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goals import GOALS, INITIAL_QPOS, THRESHOLD, build_goals, initial_qpos
from kitchen_suite.tasks.kitchen.observation import SIZE, StateSlices
from kitchen_suite.tasks.kitchen.task import KitchenTask
from kitchen_suite.types import Array

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

_DECIMALS = 2  # Trajectories are shared by object positions that are equal to this number of decimals [rad, m].

# Angles by which the hand is turned about the vertical until the poses of a skill are in reach [rad].
_TURNS = (0.0, -0.12, -0.24, 0.12, 0.24)

_ENOUGH_OF_ARC = 0.8  # Share of the arc of a door with which its task is completed.
HOME = INITIAL_QPOS[ARM]  # Joint positions in free space from which the arm starts again after a failure [rad].

# The observable of the object that each task moves and that stands on the floor, the counter or the wall; the kettle's
# pose is part of the kitchen's observation.
POSES = {task: f"{goal.prop}/pose" for task, goal in GOALS.items() if goal.prop != "kettle"}

# Poses from which the search for an arm's posture begins, beside that of the start; more find no others.
_SEARCHES = 60
# Angle below which the hand does not turn on the way to the first pose [rad].
_SAME_ANGLE = 0.02
_MOST_POSTURES = 12  # Greatest number of postures whose motions are planned.


class KitchenExpert(Expert):
    """Completes tasks of the kitchen one after the other, and repeats a failed task after the others."""

    control_modes = CONTROL_MODES
    observation_size = SIZE

    _build_goals: Callable[..., GoalSet] = staticmethod(build_goals)

    def __init__(
        self,
        tasks: Sequence[str],
        *,
        threshold: Thresholds | None = None,
        success: str | None = None,
        goals: Mapping[str, ArrayLike] | None = None,
        in_order: bool = False,
        done: float = _DONE,
        style: MotionStyle | None = None,
        control_mode: str = "joint_velocity",
        extra_observables: Sequence[str] = (),
        observes_requests: bool = False,
        robot: str | RobotSpec = FRANKA,
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
          done: distance from its goal, in units of the threshold or tolerance, below which the expert leaves a task; at
            most 1. A smaller one than the default makes demonstrations that a learner may fall short of.
          style: speed, noise and jitter of the motions.
          control_mode: the environment's.
          extra_observables: the environment's. If they include poses, such as `microwave/pose` or `franka/base_pose`,
            the observation must include all of them, and the motions are planned for the poses.
          observes_requests: whether the observation ends with `requested_tasks`, which the expert then does. Of several
            at once it cannot observe the order: with `in_order` it does them in that of `tasks`. It turns to other
            tasks when others are requested, as with the environment's `tasks_in_turn`.
          robot: the environment's.
          **control_options: arguments of the control mode: the environment's.
        """
        self._goals = self._build_goals(tasks, goals)
        robot = self._robot = robot_spec(robot)
        parts = self._parts = StateSlices.of(len(scene(robot).robot.joints))
        self._success = make_success(
            self._goals, scene(robot), default=THRESHOLD, success=success, threshold=threshold, positive=True
        )
        order = tuple(tasks) if checks.boolean(in_order, "in_order") else tuple(SKILLS)
        self._order = tuple(task for task in order if task in self._goals.tasks)
        encoder = make_encoder(make_mode(control_mode, CONTROL_MODES, control_options), arm_model(robot))
        self._layout = ObservedLayout(extra_observables, robot)
        self._num_requests = len(self._goals.tasks) if checks.boolean(observes_requests, "observes_requests") else 0
        self.observation_size = parts.size + self._layout.size + self._num_requests
        self._done = checks.number(done, "done", positive=True, maximum=1.0)
        self._is_strict = isinstance(self._success, StrictSuccess)
        precise = STRICT_SKILLS if self._is_strict else SKILLS
        self._skills = precise if encoder.turns_hand else FIXED_SKILLS
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
            "extra_observables": tuple(task.quantities.by_name),
            "observes_requests": task.mdp.ordering.draw is not None,
            "in_order": task.mdp.ordering.in_order,
            "robot": task.robot.specification,
        }

    def without_goals(self, flat: NDArray) -> NDArray:
        count = self._num_requests
        return np.concatenate([flat[: self.observation_size - count], flat[flat.size - count :]])

    def missing_observables(self, varied: Collection[str]) -> list[str]:
        needed = needed_observables(self._goals.tasks, varied, self._layout.base)
        return [name for name in needed if name not in self._layout.slices]

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        # All tasks to be done, and those that remain, of which the first is under way.
        self._tasks: tuple[str, ...] = ()
        self._remaining: collections.deque[str] = collections.deque()

    def robot_positions(self, observation: Array) -> Array:
        return observation[self._parts.robot_positions]

    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        requested, distances = self._requested(observation), self._relative_distances(observation)
        if self._trajectory is None or requested != self._tasks:
            # What is under way is left for the tasks that are requested now.
            retreat = self._plan_retreat(joints) if self._remaining else JointTrajectory.stationary(joints, OPEN)
            self._tasks, self._remaining = requested, collections.deque(requested)
            return self._then_first_task(retreat, observation)
        distance = distances[self._remaining[0]] if self._remaining else None
        if self._is_strict:
            # Near their goals objects are moved more slowly.
            slowed = 1.0 if distance is None else max((distance - 1.0) / _SLOW_DISTANCE, _LEAST_PACE)
            self._pace = min(slowed, 1.0)
        if distance is None:
            if self._has_failed:
                # The last retreat has ended; some tasks may have come undone.
                self._remaining.extend(task for task in self._tasks if distances[task] > _UNDONE)
            rest = JointTrajectory.stationary(joints, OPEN)
            return self._then_first_task(rest, observation) if self._remaining else None
        if distance < self._done:
            self._remaining.popleft()
            return self._then_first_task(self._plan_retreat(joints), observation)
        if self._has_failed:
            home = JointTrajectory.stationary(_home(self._robot), OPEN)
            self._remaining.rotate(-1)
            return self._then_first_task(self._plan_retreat(joints).then(home, self._limits), observation)
        return None

    @property
    def _has_failed(self) -> bool:
        """Whether the trajectory has ended, after which the task under way should have been complete."""
        return self._has_ended(_SETTLE_STEPS)

    def _requested(self, observation: Array) -> tuple[str, ...]:
        """Returns the tasks that an observation asks for, in the order in which to do them."""
        if not self._num_requests:
            return self._order
        requests = zip(self._goals.tasks, observation[-self._num_requests :] > 0.5, strict=True)
        wanted = {task for task, is_asked in requests if is_asked}
        return tuple(task for task in self._order if task in wanted)

    def _relative_distances(self, observation: Array) -> dict[str, float]:
        """Distances of the objects from the tasks' goals, in units of the threshold or tolerance."""
        positions = np.concatenate([self._achieved(task, observation) for task in self._goals.tasks])
        return dict(zip(self._goals.tasks, self._success.ratios(positions).tolist(), strict=True))

    def _then_first_task(self, trajectory: JointTrajectory, observation: Array) -> JointTrajectory:
        """Appends the trajectory of the first remaining task, if there is one; postpones tasks that are out of reach.

        If all tasks are out of reach, the first one is tried.
        """
        if not self._remaining:
            return trajectory
        for _ in range(len(self._remaining)):
            planned = self._plan_task(self._remaining[0], observation)
            if not self._layout.slices or planned.is_reachable:
                return trajectory.then(planned, self._limits)
            self._remaining.rotate(-1)
        return trajectory.then(self._plan_task(self._remaining[0], observation), self._limits)

    def _plan_task(self, task: str, observation: Array) -> JointTrajectory:
        """Chooses and plans a skill for a task, for the present positions of the joints of its goal."""
        frame = self._layout.frame(task, observation[self._parts.size :])
        skill, position = self._choose_skill(task, observation, frame)
        self._skill = skill
        if frame is not None:
            return self._plan_in_frame(skill, position, frame)
        if self._style.jitter:
            return self._plan(skill, object_position=position)
        rounded = None if position is None else tuple(position.round(_DECIMALS).tolist())
        return _cached_plan(skill, rounded, self._limits, self._robot)

    def _plan_in_frame(self, skill: Skill, position: Array | None, frame: mink.SE3) -> JointTrajectory:
        """Plans a skill in a frame; the hand is turned a little where its poses are out of reach."""
        tried = []
        for turn in _TURNS if self.encoder.turns_hand else _TURNS[:1]:
            planned = self._plan(skill.turned(turn) if turn else skill, frame=frame, object_position=position)
            if planned.is_reachable and planned.arc_share >= _ENOUGH_OF_ARC:
                return planned
            tried.append(planned)
        return max(tried, key=lambda planned: (planned.is_reachable, planned.arc_share))

    def _achieved(self, task: str, observation: Array) -> Array:
        """Positions of the joints of a task's goal in an observation [rad, m, quaternion]."""
        return observation[self._parts.object_positions][_elements()[task]]

    def _choose_skill(self, task: str, observation: Array, frame: mink.SE3 | None) -> tuple[Skill, Array | None]:
        """Returns a skill for a task, and the position of its object."""
        turns_hand = self.encoder.turns_hand
        kettle, doors = (self._achieved(name, observation) for name in ("kettle", "hinge cabinet"))
        skill = kitchen_skills.adapted(
            self._skills[task], task, kettle[:3], *doors, shuts_left_door=self._is_strict and turns_hand
        )
        achieved, joint = self._achieved(task, observation), skill.object_joint
        position = achieved[list(joint.elements)] if joint else None
        skill = _seeded(skill, self._robot, position)
        if frame is not None and not turns_hand:
            rotation = frame.rotation().inverse() @ kitchen_skills.AT_RESET.rotation
            skill = skill.with_orientation(HandOrientation.from_rotation(rotation))
        return skill, position


@functools.lru_cache(maxsize=1024)
def _cached_plan(
    skill: Skill, object_position: tuple[float, ...] | None, limits: JointSpeedLimits, robot: RobotSpec
) -> JointTrajectory:
    """Trajectory of a skill without jitter; cached, as it is the same in nearly all episodes."""
    position = None if object_position is None else np.array(object_position)
    return plan(arm_model(robot).kinematics, limits, skill, object_position=position)


def _seeded(skill: Skill, robot: RobotSpec, position: Array | None) -> Skill:
    """Returns a skill whose `ik_seed` is of a robot, for a position of its object; that of skills is the Franka's."""
    if robot.name == FRANKA:
        return skill
    rounded = None if position is None else tuple(position.round(1).tolist())
    return dataclasses.replace(skill, ik_seed=_posture(skill, robot, rounded))


@functools.cache
def _posture(skill: Skill, robot: RobotSpec, object_position: tuple[float, ...] | None) -> tuple[float, ...]:
    """Searches joint positions of another arm for the first motion of a skill, from which all others follow [rad].

    Of those with which the hand reaches all poses, it is the one with the fewest contacts of the arm on the way, and
    the nearest to the start. A hand that does not turn takes the arm along in one way only.
    """
    arm, home = arm_model(robot), _home(robot)
    kinematics, generator = arm.kinematics, np.random.default_rng(0)
    first = skill.lines[0].pose
    position = None if object_position is None else np.array(object_position)
    if skill.object_joint and position is not None:
        first = skill.object_joint.displacement(position) @ first
    limits = JointSpeedLimits(joint_speed=arm.joint_speed, timestep=arm.timestep)
    here, along = kinematics.forward(home), home
    found: list[Array] = []
    for share in np.linspace(0.0, 1.0, 12):
        along = kinematics.inverse(here.interpolate(first, alpha=share), start=along)
    if np.linalg.norm((here.rotation().inverse() @ first.rotation()).log()) < _SAME_ANGLE:
        return tuple(along.tolist())
    for start in (along, home, *(home + generator.uniform(-np.pi, np.pi, (_SEARCHES, home.size)))):
        joints = kinematics.inverse(first, start=start)
        error = (kinematics.forward(joints).inverse() @ first).log()
        if np.abs(error).max() < OUT_OF_REACH and all(np.abs(joints - other).max() > 0.3 for other in found):
            found.append(joints)
    best, least = home, (np.inf,) * 3
    for joints in sorted(found, key=lambda each: float(np.abs(each - home).max()))[:_MOST_POSTURES]:
        seeded = dataclasses.replace(skill, ik_seed=tuple(joints.tolist()))
        planned = plan(kinematics, limits, seeded, frame=mink.SE3.identity(), object_position=position)
        approach = np.linspace(home, planned.knots[0], 12)
        score = (
            max(planned.position_error - OUT_OF_REACH, 0.0) + 1.0 - planned.arc_share,
            _contacts(np.concatenate([approach, planned.knots]), robot),
            float(np.abs(joints - home).max()),
        )
        best, least = (joints, score) if score < least else (best, least)
    return tuple(best.tolist())


def _contacts(path: Array, robot: RobotSpec) -> int:
    """Returns at how many of joint positions `(n, k)` a link of the arm touches anything in the kitchen."""
    physics, links = _kitchen(robot)
    model, data, count = physics.model.ptr, physics.data.ptr, 0
    joints = physics.bind(scene(robot).robot.joints[: path.shape[1]]).qposadr
    for row in path:
        data.qpos[joints] = row
        mujoco.mj_fwdPosition(model, data)
        touching = model.geom_bodyid[data.contact.geom[: data.ncon]]
        count += bool(np.isin(touching, links).any())
    return count


@functools.cache
def _kitchen(robot: RobotSpec) -> tuple[mjcf.Physics, NDArray[np.int64]]:
    """The kitchen at the start of an episode, and the bodies of the arm's links but the last."""
    built = scene(robot)
    physics = mjcf.Physics.from_mjcf_model(built.arena.mjcf_model)
    qpos = initial_qpos(built.robot)
    physics.bind(built.robot.joints).qpos = qpos[: len(built.robot.joints)]
    physics.data.qpos[addresses(physics, built.object_joints)[0]] = qpos[len(built.robot.joints) :]
    links = [joint.parent for joint in built.robot.joints[: built.robot.arm_size - 1]]
    return physics, physics.bind(links).element_id


class ObservedLayout:
    """Reads the poses among the extra observables of an observation.

    Attributes:
      base: name of the pose of the robot's base.
      slices: slice of each pose that is observed, among the extra observables.
      size: number of all extra observables' elements; 0 if none of them is a pose of the layout.
    """

    def __init__(self, extras: Sequence[str], robot: RobotSpec = KITCHEN_FRANKA) -> None:
        """Looks up the poses; `extras` are the names of the task's extra observables."""
        self._robot = robot
        self.base = f"{scene(robot).robot.mjcf_model.model}/base_pose"
        slices = extra_observables.slices(scene(robot), extras) if len(extras) else {}
        self.slices = {name: part for name, part in slices.items() if name in {self.base, *POSES.values()}}
        self.size = max((part.stop for part in slices.values()), default=0) if self.slices else 0

    def frame(self, task: str, extras: Array) -> mink.SE3 | None:
        """Returns the transform of a task's poses, from the default layout to that in the extra observables `(size,)`.

        The transform is for planning with the robot's base at its default pose. It is None if no pose is observed.
        """
        if not self.slices:
            return None
        return self._moved(self.base, extras).inverse() @ self._moved(POSES.get(task), extras)

    def _moved(self, name: str | None, extras: Array) -> mink.SE3:
        """Returns the transform from a default pose to the observed one; the identity if it is not observed."""
        if name not in self.slices:
            return mink.SE3.identity()
        return _pose(extras[self.slices[name]]) @ _default_poses(self._robot)[name].inverse()


def needed_observables(tasks: Collection[str], varied: Collection[str], base: str = f"{FRANKA}/base_pose") -> list[str]:
    """Returns the names of the poses that the expert must observe for its tasks where parameters vary."""
    owners = {name.partition("/")[0] for name in varied if name.endswith(("/offset", "/yaw"))}
    needed = {POSES[task] for task in tasks if task in POSES and GOALS[task].prop in owners}
    return sorted(needed | ({base} if "pedestal" in owners else set()))


@functools.cache
def _default_poses(robot: RobotSpec) -> Mapping[str, mink.SE3]:
    """Poses in the world of the default layout by name."""
    built = scene(robot)
    physics = mjcf.Physics.from_mjcf_model(built.arena.mjcf_model)
    entities = {f"{built.robot.mjcf_model.model}/base_pose": built.robot}
    entities |= {f"{name}/pose": prop for name, prop in built.props.items() if f"{name}/pose" in POSES.values()}
    frames = {name: physics.bind(mjcf.get_attachment_frame(each.mjcf_model)) for name, each in entities.items()}
    return {name: _pose(np.concatenate([frame.xpos, frame.xquat])) for name, frame in frames.items()}


def _pose(values: Array) -> mink.SE3:
    """Returns the pose of a position and a quaternion `(7,)`."""
    return mink.SE3.from_rotation_and_translation(mink.SO3(wxyz=values[3:]).normalize(), values[:3])


@functools.cache
def arm_model(robot: RobotSpec = KITCHEN_FRANKA) -> ArmModel:
    """The arm in the kitchen, shared by all instances."""
    built = scene(robot).robot
    return ArmModel(
        kinematics=ArmKinematics(KitchenArena, built.specification),
        gains=built.gains,
        # In a control step, of the position error: gain and damping of a joint make a first-order lag.
        joint_response=1.0 - np.exp(-CONTROL_TIMESTEP * built.gains / built.damping),
        hand_response=0.55,
        # That the actuators can follow. The shoulder's limit is 0.06: its torque limit less the torque of gravity.
        joint_speed=(0.06,) * 4 + (0.08,) * (built.arm_size - 4),
        timestep=CONTROL_TIMESTEP,
    )


@functools.cache
def scene(robot: RobotSpec = KITCHEN_FRANKA) -> Scene:
    """The kitchen without visuals, shared by all instances."""
    return build_kitchen_scene(visuals=False, robot=robot)


def _home(robot: RobotSpec) -> Array:
    """Positions of the arm's joints at the start of an episode [rad]."""
    built = scene(robot).robot
    return np.array(built.home[: built.arm_size])


@functools.cache
def _elements() -> Mapping[str, NDArray[np.int64]]:
    """Indices of the positions of each goal's joints among the object positions of the observation, by task."""
    return {task: goal.elements_in(scene()) for task, goal in GOALS.items()}

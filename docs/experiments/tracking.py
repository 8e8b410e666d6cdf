"""How well the control modes of the end effector hold still, and follow straight lines."""

import dataclasses
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import rotations

# Modes with an action that leaves the end effector where it is, and those that can follow a line.
HOLDING_MODES = ("joint_delta", "ee_delta_position", "ee_delta_pose", "ee_pose")
LINE_MODES = HOLDING_MODES[1:]

# Length of the lines [m], and the speed along them [m/s], half of the modes' greatest.
LINE_LENGTH = 0.15
LINE_SPEED = 0.125

SETTLE_STEPS = 4  # Control steps in which the arm settles after a reset.
PAUSE_STEPS = 20  # Control steps at rest before a line.
REST_STEPS = 5  # Control steps at rest after a line.

# Time after a contact in which the arm is still coming free [s], of at least two control steps.
FREED_SECONDS = 0.08

OPEN_GRIPPER = -1.0


def load(domain_name: str, control_mode: str, **settings: Any) -> Environment:
    """Loads a domain's default task without visuals and without an end, and resets it.

    Args:
      domain_name: a key of `suite.DOMAINS`.
      control_mode: name of the mode.
      **settings: further arguments of the domain's builder.
    """
    domain = suite.find_domain(domain_name)
    options: dict[str, Any] = {"random": 0, "visuals": False, "time_limit": None, "control_mode": control_mode}
    if domain_name == "kitchen":
        options["terminate_on_tasks_completed"] = False
    environment = suite.load(domain_name, domain.default_task, {**options, **settings})
    environment.reset()
    return environment


def end_effector_pose(environment: Environment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns position `(3,)` [m] and orientation `(4,)` of the end effector in the world."""
    return _pose(environment.physics.bind(environment.task.robot.end_effector))


def base_pose(environment: Environment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns position `(3,)` [m] and orientation `(4,)` of the robot's base in the world."""
    return _pose(environment.physics.bind(mjcf.get_attachment_frame(environment.task.robot.mjcf_model)))


def _pose(bound: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    orientation = np.zeros(4)
    mujoco.mju_mat2Quat(orientation, np.array(bound.xmat).ravel())
    return np.array(bound.xpos), orientation


def angle(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Returns the angle between two orientations `(4,)` [degrees]."""
    return float(np.degrees(rotations.length(rotations.difference(one, other)).item()))


def pose_action(
    environment: Environment, position: NDArray[np.float64], orientation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns the action `(8,)` of `ee_pose` for a pose in the world, with an open gripper."""
    base, base_orientation = base_pose(environment)
    inverse = rotations.inverse(base_orientation)
    return np.concatenate(
        [rotations.rotated(inverse, position - base), rotations.product(inverse, orientation), [OPEN_GRIPPER]]
    )


def holding_action(environment: Environment, control_mode: str) -> NDArray[np.float64]:
    """Returns an action that leaves the end effector where it is now, with an open gripper."""
    if control_mode == "ee_pose":
        return pose_action(environment, *end_effector_pose(environment))
    action = np.zeros(environment.action_spec().shape)
    action[-1] = OPEN_GRIPPER
    return action


def drift(environment: Environment, control_mode: str, steps: int) -> tuple[float, float]:
    """Holds the end effector; returns how far it goes from its place after four control steps [m, degrees].

    Args:
      environment: just reset.
      control_mode: its control mode, one of `HOLDING_MODES`.
      steps: control steps.
    """
    action = holding_action(environment, control_mode)
    distance = 0.0
    turn = 0.0
    for _ in range(SETTLE_STEPS):
        environment.step(action)
    position, orientation = end_effector_pose(environment)
    for _ in range(steps - SETTLE_STEPS):
        environment.step(action)
        present, turned = end_effector_pose(environment)
        distance = max(distance, float(np.linalg.norm(present - position)))
        turn = max(turn, angle(turned, orientation))
    return distance, turn


@dataclasses.dataclass(frozen=True)
class Line:
    """The path of the end effector along a straight line that was asked for.

    Attributes:
      offsets: `(n, 3)`, positions relative to the start after each control step: along the line, and across it [m].
      commanded: `(n,)`, commanded positions along the line [m].
      angles: `(n,)`, angles from the orientation at the start [degrees].
    """

    offsets: NDArray[np.float64]
    commanded: NDArray[np.float64]
    angles: NDArray[np.float64]

    @property
    def lateral(self) -> float:
        """Greatest distance from the line [m]."""
        return float(np.linalg.norm(self.offsets[:, 1:], axis=1).max())

    @property
    def rotation(self) -> float:
        """Greatest angle from the orientation at the start [degrees]."""
        return float(self.angles.max())

    @property
    def shortfall(self) -> float:
        """Distance from the end of the line after the rest, along the line [m]."""
        return float(self.commanded[-1] - self.offsets[-1, 0])


def follow_line(environment: Environment, control_mode: str, axis: int, sign: int) -> Line:
    """Moves the end effector 15 cm along an axis of the base, at half of the greatest speed.

    The middle of the line is the place of the reset, from which the arm moves back to the start of the line at first.

    Args:
      environment: just reset.
      control_mode: its control mode, one of `LINE_MODES`.
      axis: 0, 1 or 2.
      sign: 1 or -1.
    """
    timestep, base = environment.control_timestep(), base_pose(environment)[1]
    count = round(LINE_LENGTH / (LINE_SPEED * timestep))
    direction = np.zeros(3)
    direction[axis] = sign
    start = _Mover(environment, control_mode)
    for _ in range(count // 2):
        start.move(-direction * LINE_SPEED)
    for _ in range(PAUSE_STEPS):
        start.move(np.zeros(3))
    position, orientation = end_effector_pose(environment)
    # Along the line first, then across.
    axes = np.roll(np.eye(3), -axis, axis=0) * sign
    offsets, angles = [], []
    for number in range(count + REST_STEPS):
        start.move(direction * LINE_SPEED if number < count else np.zeros(3))
        present, turned = end_effector_pose(environment)
        offsets.append(axes @ rotations.rotated(rotations.inverse(base), present - position))
        angles.append(angle(turned, orientation))
    commanded = np.minimum(np.arange(1, count + REST_STEPS + 1), count) * LINE_SPEED * timestep
    return Line(np.array(offsets), commanded, np.array(angles))


class _Mover:
    """Moves an end effector at velocities along the axes of the base, in any of `LINE_MODES`."""

    def __init__(self, environment: Environment, control_mode: str) -> None:
        self._environment, self._mode = environment, control_mode
        self._position, self._orientation = end_effector_pose(environment)

    def move(self, velocity: NDArray[np.float64]) -> None:
        """Makes a control step at a velocity `(3,)` [m/s]."""
        environment = self._environment
        if self._mode == "ee_pose":
            step = velocity * environment.control_timestep()
            self._position = self._position + rotations.rotated(base_pose(environment)[1], step)
            action = pose_action(environment, self._position, self._orientation)
        else:
            action = holding_action(environment, self._mode)
            action[:3] = velocity / (2.0 * LINE_SPEED)
        environment.step(action)


@dataclasses.dataclass(frozen=True)
class Drive:
    """How fast an arm moved while the hand was commanded into one direction, in each control step.

    Attributes:
      ratios: `(k,)`, speed of the hand, as a multiple of the commanded one.
      joint_speeds: `(k,)`, greatest speed of a joint at the end of the control step [rad/s].
      touches: `(k,)` bool, whether the robot touched something at the end of the control step, or shortly before, so
        that what held it back may just have come free.
    """

    ratios: NDArray[np.float64]
    joint_speeds: NDArray[np.float64]
    touches: NDArray[np.bool_]


def drive(environment: Environment, direction: NDArray[np.float64], seconds: float) -> Drive:
    """Commands the hand of an `ee_delta` mode into a direction `(3,)` from a reset, on to the border of its reach."""
    environment.reset()
    physics, robot = environment.physics, environment.task.robot
    joints = physics.bind(robot.joints[: robot.arm_size])
    geoms = physics.bind(robot.mjcf_model.find_all("geom")).element_id
    timestep = environment.control_timestep()
    action = np.zeros(environment.action_spec().shape)
    action[:3] = direction
    commanded = environment.task.mdp.action_mode.linear_speed * np.linalg.norm(direction)
    ratios = []
    joint_speeds = []
    touches = []
    position, _ = end_effector_pose(environment)
    for _ in range(round(seconds / timestep)):
        if environment.step(action).last():
            break
        before, (position, _) = position, end_effector_pose(environment)
        ratios.append(np.linalg.norm(position - before) / timestep / commanded)
        joint_speeds.append(np.abs(joints.qvel).max())
        touches.append(bool(np.isin(physics.data.contact.geom[: physics.data.ncon], geoms).any()))
    recent = max(2, round(FREED_SECONDS / timestep))
    freed = [any(touches[max(0, step - recent) : step + 1]) for step in range(len(touches))]
    return Drive(np.array(ratios), np.array(joint_speeds), np.array(freed))

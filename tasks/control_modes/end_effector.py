"""Control modes of the end effector: its pose, or changes of its commanded pose, by differential inverse kinematics."""

import abc
from typing import Any, NamedTuple

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs

from kitchen_suite import checks
from kitchen_suite.entities.robot import Robot
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.control_modes import inverse_kinematics, speed_limits
from kitchen_suite.tasks.control_modes.action_mode import ActionMode, unit_spec
from kitchen_suite.tasks.control_modes.joints import MAX_SPEED, ArmServos, Gripper
from kitchen_suite.tasks.simulation import Simulation, as_columns
from kitchen_suite.types import Array

# Time constant with which the end effector approaches its target: the greater one of these two. Longer, and it lags
# behind; shorter, and the servos' torques reach their limits.
_LEAST_RESPONSE = 0.05  # The least one [s].
_RESPONSE_STEPS = 1.25  # In control steps.

# Rate at which the null space of the end effector's pose returns to the posture of the reset [1/s].
_POSTURE_RATE = 0.25

FRAMES = ("base", "hand")

# Greatest distance of the commanded pose from the actual one: nothing winds up against obstacles.
COMMAND_DISTANCE = 0.08  # Of the position [m].
COMMAND_ANGLE = 0.3  # Of the orientation [rad].

# Greatest distance of a commanded position from the robot's base along each axis [m].
REACH = 1.0

# Least norm of a commanded quaternion.
_LEAST_NORM = 1e-6


class ArmKinematics:
    """Kinematics of the arm in a compiled scene, for one simulation or many.

    Attributes:
      servos: of its joints.
    """

    def __init__(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:
        """Looks up joints, end effector and base.

        Args:
          physics: the compiled scene.
          robot: the robot; attached to a frame of its own.
          timestep: length of a control step [s].
        """
        self.servos = ArmServos(physics, robot)
        site, base = robot.end_effector, mjcf.get_attachment_frame(robot.mjcf_model)
        self._joints = as_columns(physics.bind(robot.joints[: robot.arm_size]).element_id)
        self._site, self._body, self._base = (
            np.atleast_1d(physics.bind(element).element_id) for element in (site, site.parent, base)
        )
        self._site_quat = np.array(physics.bind(site).quat)
        self._response = max(_LEAST_RESPONSE, _RESPONSE_STEPS * timestep)
        # In longer control steps the servos reach their velocities, and what holds the hand back is not seen.
        self._has_limits = self.servos.have_feedback and self._response > _RESPONSE_STEPS * timestep

    def pose(self, simulation: Simulation) -> tuple[Array, Array]:
        """Returns the end effector's position `(..., 3)` [m] and orientation `(..., 4)` in the world."""
        body = simulation.read("xquat", self._body)[..., 0, :]
        return simulation.read("site_xpos", self._site)[..., 0, :], rotations.product(body, self._site_quat)

    def base_pose(self, simulation: Simulation) -> tuple[Array, Array]:
        """Returns the base's position `(..., 3)` [m] and orientation `(..., 4)` in the world."""
        return simulation.read("xpos", self._base)[..., 0, :], simulation.read("xquat", self._base)[..., 0, :]

    def target(self, simulation: Simulation, error: Array, posture: Array, speed: Array | None = None) -> Array:
        """Returns targets `(..., 7)` of the arm's servos that move the end effector towards its target [rad].

        Args:
          simulation: the physics.
          error: `(..., 6)`, the target's offset from the end effector in the world: position [m], rotation vector.
          posture: `(..., 7)`, joint positions to which the null space returns [rad].
          speed: `(...)`, commanded speed of the end effector, which it is to keep near [m/s]; None if it has none.
        """
        servos, present = self.servos, self.servos.positions(simulation)
        # A joint that stands beyond its limit may stay there.
        low, high = np.minimum(servos.low - present, 0.0), np.maximum(servos.high - present, 0.0)
        jacobian = inverse_kinematics.jacobian(
            simulation.read("site_xpos", self._site)[..., 0, :],
            simulation.read("xanchor", self._joints),
            simulation.read("xaxis", self._joints),
        )
        step = inverse_kinematics.joint_step(
            jacobian,
            error,
            posture=self._response * _POSTURE_RATE * (posture - present),
            low=low,
            high=high,
        )
        if self._has_limits and speed is not None:
            velocities = step / self._response
            limited = speed_limits.limited(servos, simulation, jacobian, velocities, speed)
            # Steps within the limits keep their bits, which a division and a product may not.
            if limited is not velocities:
                step = np.where(limited == velocities, step, limited * self._response)
        # All joints then move with the same time constant, and the end effector on a straight line.
        return servos.target(simulation, present + servos.lag / self._response * step)


class PoseCommand(NamedTuple):
    """A commanded pose, in the world.

    Attributes:
      position: `(..., 3)`, of the end effector [m].
      orientation: `(..., 4)`, quaternion w, x, y, z.
      posture: `(..., 7)`, positions of the arm's joints at the reset, to which the null space returns [rad].
    """

    position: Array
    orientation: Array
    posture: Array


class EndEffectorMode(ActionMode):
    """A mode that commands the pose of the site between the fingers; the last element of the action is the gripper."""

    formula = (
        "ctrl[:7]: differential inverse kinematics of the commanded pose, which kitchen_suite.tasks.control_modes "
        "computes; both fingers: from open at action[-1] = -1 to closed at 1, linear between"
    )
    suits_any_robot = True
    stage = mujoco.mjtStage.mjSTAGE_VEL

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:
        self._arm = ArmKinematics(physics, robot, timestep)
        self._gripper = Gripper(robot)
        self._timestep = timestep

    def start(self, simulation: Simulation) -> PoseCommand:
        position, orientation = self._arm.pose(simulation)
        return PoseCommand(np.array(position), orientation, np.array(self._arm.servos.positions(simulation)))

    def control(
        self, simulation: Simulation, state: Any, command: PoseCommand, action: Array, draw: Array | float
    ) -> tuple[Array, PoseCommand]:
        action = np.minimum(np.maximum(action, -1.0), 1.0)
        requested = self._requested(simulation, command, action)
        position, orientation = self._arm.pose(simulation)
        # The requested pose, brought near the actual one.
        offset = rotations.within(requested.position - position, COMMAND_DISTANCE)
        rotation = rotations.within(rotations.difference(requested.orientation, orientation), COMMAND_ANGLE)
        held = PoseCommand(
            position + offset, rotations.product(rotations.quaternion(rotation), orientation), posture=command.posture
        )
        error = np.concatenate([offset, rotation], axis=-1)
        arm = self._arm.target(simulation, error, command.posture, self._commanded_speed(action))
        return np.concatenate([arm, self._gripper.target(action[..., -1:])], axis=-1), self._kept(command, held)

    @abc.abstractmethod
    def _requested(self, simulation: Simulation, command: PoseCommand, action: Array) -> PoseCommand:
        """Returns the pose that an action requests, which may be far away."""

    def _kept(self, command: PoseCommand, held: PoseCommand) -> PoseCommand:
        """Returns what the next control step starts from, given the commands before and after this one."""
        return held

    def _commanded_speed(self, action: Array) -> Array | None:
        """Returns the speed `(...)` that the end effector is to keep near [m/s]; None if it has none."""
        return None


class _DeltaMode(EndEffectorMode):
    """A mode that changes the commanded pose."""

    def __init__(self, *, linear_speed: float, frame: str) -> None:
        self.linear_speed = checks.number(linear_speed, "linear_speed", positive=True, maximum=MAX_SPEED)
        self.frame = checks.choice(frame, FRAMES, "frame")

    def _commanded_speed(self, action: Array) -> Array:
        # At least that of a unit: a shorter action may follow upon one with which the arm still catches up.
        return self.linear_speed * np.maximum(rotations.length(action[..., :3])[..., 0], 1.0)

    def _moved(self, simulation: Simulation, command: PoseCommand, action: Array) -> PoseCommand:
        """Returns a command with the position that the first three elements of an action request."""
        step = self.linear_speed * self._timestep * action[..., :3]
        return command._replace(position=command.position + self._in_world(simulation, command, step))

    def _in_world(self, simulation: Simulation, command: PoseCommand, vectors: Array) -> Array:
        """Returns vectors `(..., 3)` of the action's frame in the world."""
        frame = self._arm.base_pose(simulation)[1] if self.frame == "base" else command.orientation
        return rotations.rotated(frame, vectors)


class EndEffectorDeltaPosition(_DeltaMode):
    """`ee_delta_position`: changes of the commanded position; the orientation of the reset is held."""

    name = "ee_delta_position"

    def __init__(self, *, linear_speed: float = 0.25, frame: str = "base") -> None:
        """Sets the speed that a unit of action stands for, at most 10 [m/s], and its axes' frame, `base` or `hand`."""
        super().__init__(linear_speed=linear_speed, frame=frame)

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Velocity x, y, z as a share of `linear_speed`, and the gripper: +1 closed, -1 open; in [-1, 1]."""
        return unit_spec(["x", "y", "z", "gripper"])

    def _requested(self, simulation: Simulation, command: PoseCommand, action: Array) -> PoseCommand:
        return self._moved(simulation, command, action)

    def _kept(self, command: PoseCommand, held: PoseCommand) -> PoseCommand:
        return held._replace(orientation=command.orientation)


class EndEffectorDeltaPose(_DeltaMode):
    """`ee_delta_pose`: changes of the commanded position and orientation."""

    name = "ee_delta_pose"

    def __init__(self, *, linear_speed: float = 0.25, angular_speed: float = 1.0, frame: str = "base") -> None:
        """Sets speeds and frame.

        Args:
          linear_speed: speed that a unit of action stands for, at most 10 [m/s].
          angular_speed: angular speed that a unit of action stands for, at most 10 [rad/s].
          frame: `base` or `hand`: the axes along and about which the action moves and turns the end effector.
        """
        super().__init__(linear_speed=linear_speed, frame=frame)
        self.angular_speed = checks.number(angular_speed, "angular_speed", positive=True, maximum=MAX_SPEED)

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Velocity x, y, z as a share of `linear_speed`, rotation vector, gripper: +1 closed, -1 open; in [-1, 1]."""
        return unit_spec(["x", "y", "z", "rotation_x", "rotation_y", "rotation_z", "gripper"])

    def _requested(self, simulation: Simulation, command: PoseCommand, action: Array) -> PoseCommand:
        rotation = self._in_world(simulation, command, self.angular_speed * self._timestep * action[..., 3:6])
        moved = self._moved(simulation, command, action)
        return moved._replace(orientation=rotations.product(rotations.quaternion(rotation), command.orientation))


class EndEffectorPose(EndEffectorMode):
    """`ee_pose`: a pose in the frame of the robot's base."""

    name = "ee_pose"

    def spec(self, robot: Robot) -> specs.BoundedArray:
        """Position x, y, z within 1 m of the base, quaternion w, x, y, z, gripper: +1 closed, -1 open; in [-1, 1]."""
        return unit_spec(["x", "y", "z", "quaternion_w", *(f"quaternion_{axis}" for axis in "xyz"), "gripper"])

    def check(self, action: Array) -> None:
        if (least := rotations.length(np.clip(action[..., 3:7], -1.0, 1.0)).min()) < _LEAST_NORM:
            raise ValueError(f"the quaternion of an action must have a norm of at least {_LEAST_NORM:g}, got {least:g}")

    def _requested(self, simulation: Simulation, command: PoseCommand, action: Array) -> PoseCommand:
        base, base_orientation = self._arm.base_pose(simulation)
        position = base + rotations.rotated(base_orientation, REACH * action[..., :3])
        unit = action[..., 3:7] / rotations.length(action[..., 3:7])
        return command._replace(position=position, orientation=rotations.product(base_orientation, unit))

"""Action encoders: they turn the joint positions that an expert plans into actions of a control mode."""

import abc
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import mink
import numpy as np

from kitchen_suite import checks
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.skills import CLOSED, OPEN
from kitchen_suite.policies.experts.trajectories import HandSpeedLimits, JointSpeedLimits
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.control_modes import end_effector
from kitchen_suite.tasks.control_modes import joints as joint_modes
from kitchen_suite.tasks.control_modes.action_mode import ActionMode
from kitchen_suite.tasks.kitchen import control_modes as kitchen_action
from kitchen_suite.types import Array

# Distances of the hand, and of a joint, from the target beyond which they do not follow [m, rad; rad].
_MAX_DISTANCE, _MAX_ANGLE, _MAX_LAG = 0.1, 0.5, 0.25

# Fraction of the mode's speeds at which trajectories move, so that actions can still correct errors.
_SPEED_RESERVE = 0.9

# Greatest speeds of the hand in `ee_pose`, and angular speed in `ee_delta_position` [m/s, rad/s]: the defaults of the
# modes that have speeds.
_LINEAR_SPEED, _ANGULAR_SPEED = 0.25, 1.0

# The velocity scale for which the joint speeds hold: velocity of a joint for an action of one [rad/s].
_VELOCITY_SCALE = 2.0

_CLOSE_LOGIT = 50.0  # Gripper logit at which a sampled gripper closes almost surely.


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmModel:
    """A robot and its control, as encoders see them.

    Attributes:
      kinematics: of the arm.
      gains: of the servos of the arm's seven joints [N m/rad].
      joint_response: `(7,)`, or one number for all: fraction of a joint's position error that an action is to remove;
        where it is below 1, servo targets lead the joints, so that these follow without lag.
      hand_response: the same for the error of the hand's pose in the modes of the end effector.
      joint_speed: greatest speeds of the seven joints [rad / control step].
      timestep: length of a control step [s].
    """

    kinematics: ArmKinematics
    gains: Array
    joint_response: Array | float
    hand_response: float
    joint_speed: Sequence[float]
    timestep: float

    def gravity_offset(self, joints: Array) -> Array:
        """Offsets `(7,)` of servo targets that hold the arm at joint positions `(7,)` [rad]."""
        return self.kinematics.gravity(joints) / self.gains

    def servo_targets(self, joints: Array, target: Array) -> Array:
        """Servo targets `(7,)` that move the arm from joint positions `(7,)` to a target `(7,)` and hold it [rad]."""
        return self.led(joints, target) + self.gravity_offset(joints)

    def led(self, joints: Array, target: Array) -> Array:
        """Joint positions `(7,)` that lead the target as far as the joints would lag behind it [rad]."""
        return joints + (target - joints) / self.joint_response


class ActionEncoder(abc.ABC):
    """Turns targets of joints and fingers into actions of one control mode.

    Attributes:
      turns_hand: whether actions can turn the hand; otherwise it keeps its orientation at the reset.
      sets_posture: whether actions set the positions of all joints; otherwise the mode keeps near those at the reset.
      limits: speeds that the mode can follow.
      low, high: bounds of the action's elements.
      arm_size: number of the action's leading elements that move the arm; the others move the fingers.
      arm: the robot and its control.
    """

    turns_hand: ClassVar[bool] = True
    sets_posture: ClassVar[bool] = True

    limits: JointSpeedLimits
    low: Array | float = -1.0
    high: Array | float = 1.0
    arm_size: int = 7

    def __init__(self, mode: Any, arm: ArmModel) -> None:
        """Stores the control mode, one of those that `ENCODERS` has for the class, and the robot."""
        self._mode, self.arm = mode, arm

    def reset(self, joints: Array) -> None:  # noqa: B027
        """Begins an episode at joint positions `(7,)` [rad]."""

    @abc.abstractmethod
    def follows(self, joints: Array, target: Array) -> bool:
        """Returns whether the arm, at joint positions `(7,)`, is near its target `(7,)` [rad]."""

    @abc.abstractmethod
    def encode(self, positions: Array, target: Array, fingers: float) -> Array:
        """Returns the action that moves joints and fingers to their targets within a control step, before clipping.

        Positions are those of the robot's joints, the arm's first [rad, m]; the target `(7,)` is of the arm's joints
        [rad], `fingers` of each finger [m].
        """

    def applied(self, positions: Array, action: Array) -> None:  # noqa: B027
        """Updates the memory of the mode after an action within its bounds at observed joint positions [rad, m]."""


def _gripper_action(fingers: float) -> float:
    """Returns the gripper's element of an action for an opening of each finger [m]: +1 closed, -1 open."""
    return 1.0 - 2.0 * fingers / OPEN


class _Pose(NamedTuple):
    """Position `(3,)` [m] and orientation `(4,)`, as quaternion w, x, y, z."""

    position: Array
    orientation: Array

    @classmethod
    def of(cls, transform: mink.SE3) -> "_Pose":
        """The pose that a transform takes the world's frame to."""
        return cls(position=transform.translation(), orientation=transform.wxyz_xyz[:4])

    def moved(self, offset: Array, turn: Array) -> "_Pose":
        """This pose, displaced by an offset `(3,)` [m] and turned by a rotation vector `(3,)` of the world."""
        return _Pose(self.position + offset, rotations.product(rotations.quaternion(turn), self.orientation))

    def error(self, target: "_Pose") -> tuple[Array, Array]:
        """Offset `(3,)` [m] and rotation vector `(3,)` that bring this pose to a target, in the world."""
        return target.position - self.position, rotations.difference(target.orientation, self.orientation)

    def near(self, hand: "_Pose") -> "_Pose":
        """This pose, brought as near to the hand as commanded poses are."""
        offset, turn = hand.error(self)
        offset = rotations.within(offset, end_effector.COMMAND_DISTANCE)
        return hand.moved(offset, rotations.within(turn, end_effector.COMMAND_ANGLE))


class HandEncoder(ActionEncoder):
    """An encoder of a mode that commands the hand's pose; the mode chooses the posture of the arm."""

    sets_posture = False

    def __init__(
        self, mode: Any, arm: ArmModel, *, linear_speed: float = _LINEAR_SPEED, angular_speed: float = _ANGULAR_SPEED
    ) -> None:
        """Sets the speed limits [m/s, rad/s]."""
        super().__init__(mode, arm)
        self._base = _Pose.of(arm.kinematics.base)
        self.limits = HandSpeedLimits(
            kinematics=arm.kinematics,
            joint_speed=tuple(arm.joint_speed),
            timestep=arm.timestep,
            linear_speed=_SPEED_RESERVE * linear_speed,
            angular_speed=_SPEED_RESERVE * angular_speed,
        )

    def follows(self, joints: Array, target: Array) -> bool:
        offset, turn = self._pose(joints).error(self._pose(target))
        return bool(rotations.length(offset)[0] < _MAX_DISTANCE and rotations.length(turn)[0] < _MAX_ANGLE)

    def encode(self, positions: Array, target: Array, fingers: float) -> Array:
        hand = self._pose(positions[self.arm.kinematics.arm])
        offset, turn = (error / self.arm.hand_response for error in hand.error(self._pose(target)))
        return np.append(self._encode_pose(hand.moved(offset, turn).near(hand)), _gripper_action(fingers))

    def _pose(self, joints: Array) -> _Pose:
        """Pose of the hand at joint positions `(7,)` [rad]."""
        return _Pose.of(self.arm.kinematics.forward(joints))

    @abc.abstractmethod
    def _encode_pose(self, pose: _Pose) -> Array:
        """Returns the elements of the action that command a pose."""


class PoseEncoder(HandEncoder):
    """Encoder of `ee_pose`."""

    def _encode_pose(self, pose: _Pose) -> Array:
        to_base = rotations.inverse(self._base.orientation)
        position = rotations.rotated(to_base, pose.position - self._base.position) / end_effector.REACH
        return np.append(position, rotations.product(to_base, pose.orientation))


class _DeltaEncoder(HandEncoder):
    """An encoder of a mode that changes the commanded pose; it keeps account of that pose."""

    def __init__(self, mode: Any, arm: ArmModel, *, angular_speed: float) -> None:
        super().__init__(mode, arm, linear_speed=mode.linear_speed, angular_speed=angular_speed)
        self._frame, self._step = mode.frame, mode.linear_speed * arm.timestep

    def reset(self, joints: Array) -> None:
        self._commanded = self._pose(joints)

    def _axes(self) -> Array:
        """Orientation `(4,)` of the frame of the action."""
        return self._base.orientation if self._frame == "base" else self._commanded.orientation

    def _encode_pose(self, pose: _Pose) -> Array:
        return rotations.rotated(rotations.inverse(self._axes()), pose.position - self._commanded.position) / self._step


class DeltaPositionEncoder(_DeltaEncoder):
    """Encoder of `ee_delta_position`."""

    turns_hand = False
    arm_size = 3

    def __init__(self, mode: end_effector.EndEffectorDeltaPosition, arm: ArmModel) -> None:
        super().__init__(mode, arm, angular_speed=_ANGULAR_SPEED)

    def applied(self, positions: Array, action: Array) -> None:
        offset = rotations.rotated(self._axes(), self._step * action[:3])
        moved = self._commanded._replace(position=self._commanded.position + offset)
        self._commanded = moved.near(self._pose(positions[self.arm.kinematics.arm]))._replace(
            orientation=moved.orientation
        )


class DeltaPoseEncoder(_DeltaEncoder):
    """Encoder of `ee_delta_pose`."""

    arm_size = 6

    def __init__(self, mode: end_effector.EndEffectorDeltaPose, arm: ArmModel) -> None:
        super().__init__(mode, arm, angular_speed=mode.angular_speed)
        self._turn = mode.angular_speed * arm.timestep

    def applied(self, positions: Array, action: Array) -> None:
        axes = self._axes()
        offset = rotations.rotated(axes, self._step * action[:3])
        turn = rotations.rotated(axes, self._turn * action[3:6])
        self._commanded = self._commanded.moved(offset, turn).near(self._pose(positions[self.arm.kinematics.arm]))

    def _encode_pose(self, pose: _Pose) -> Array:
        turn = rotations.difference(pose.orientation, self._commanded.orientation)
        rotation = rotations.rotated(rotations.inverse(self._axes()), turn) / self._turn
        return np.append(super()._encode_pose(pose), rotation)


class JointEncoder(ActionEncoder):
    """An encoder of a mode that commands joints."""

    def __init__(self, mode: Any, arm: ArmModel, *, speed: float = np.inf, scale: float = 1.0) -> None:
        """Sets the speed limits: those of the arm times `scale`, and at most `speed` [rad / control step]."""
        super().__init__(mode, arm)
        speeds = tuple(min(float(each), speed) for each in np.array(arm.joint_speed) * scale)
        self.limits = JointSpeedLimits(joint_speed=speeds, timestep=arm.timestep)

    def follows(self, joints: Array, target: Array) -> bool:
        return bool(np.max(np.abs(target - joints)) < _MAX_LAG)


class VelocityEncoder(JointEncoder):
    """Encoder of the kitchen's `joint_velocity`."""

    def __init__(self, mode: kitchen_action.JointVelocity, arm: ArmModel) -> None:
        scale = checks.number(mode.velocity_scale, "velocity_scale", positive=True)
        super().__init__(mode, arm, scale=min(1.0, scale / _VELOCITY_SCALE))

    def reset(self, joints: Array) -> None:
        # The last position target, if the next one is relative to it.
        self._commanded: Array | None = None

    def encode(self, positions: Array, target: Array, fingers: float) -> Array:
        commanded = np.append(self.arm.servo_targets(positions[ARM], target), [fingers, fingers])
        return (commanded - self._base_positions(positions)) / (self._mode.velocity_scale * self.arm.timestep)

    def applied(self, positions: Array, action: Array) -> None:
        if self._mode.feedback == "target":
            unit = {"velocity_scale": self._mode.velocity_scale, "timestep": self.arm.timestep}
            self._commanded = kitchen_action.position_target(self._base_positions(positions), action, **unit)

    def _base_positions(self, observed: Array) -> Array:
        """Returns the robot positions `(9,)` to which the environment adds the action [rad, m]."""
        return observed if self._commanded is None else self._commanded


class PositionEncoder(JointEncoder):
    """Encoder of `joint_position`."""

    low, high = joint_modes.JOINT_LOW, joint_modes.JOINT_HIGH

    def encode(self, positions: Array, target: Array, fingers: float) -> Array:
        arm = self.arm.servo_targets(positions[ARM], target)
        return np.append(arm, [fingers] * (self.low.size - arm.size))


class KitchenPositionEncoder(PositionEncoder):
    """Encoder of the kitchen's `joint_position`."""

    low, high = kitchen_action.POSITION_LOW, kitchen_action.POSITION_HIGH


class OffsetEncoder(JointEncoder):
    """Encoder of `joint_offset`."""

    low, high = -np.inf, np.inf

    def encode(self, positions: Array, target: Array, fingers: float) -> Array:
        joints = positions[ARM]
        offset = (target - joints) / self.arm.joint_response + self.arm.gravity_offset(joints)
        logit = _CLOSE_LOGIT if self._mode.draws else 1.0
        return np.append(offset, logit if fingers == CLOSED else -logit)


class DeltaEncoder(JointEncoder):
    """Encoder of `joint_delta`; it keeps account of the commanded joint positions."""

    def __init__(self, mode: joint_modes.JointDelta, arm: ArmModel) -> None:
        self._step = mode.joint_speed * arm.timestep
        super().__init__(mode, arm, speed=_SPEED_RESERVE * self._step)

    def reset(self, joints: Array) -> None:
        self._commanded = joints

    def encode(self, positions: Array, target: Array, fingers: float) -> Array:
        change = self.arm.led(positions[ARM], target) - self._commanded
        return np.append(change / self._step, _gripper_action(fingers))

    def applied(self, positions: Array, action: Array) -> None:
        joints, commanded = positions[ARM], self._commanded + self._step * action[ARM]
        self._commanded = np.clip(commanded, joints - joint_modes.TARGET_DISTANCE, joints + joint_modes.TARGET_DISTANCE)


ENCODERS: Mapping[type[ActionMode], Callable[[Any, ArmModel], ActionEncoder]] = MappingProxyType(
    {
        kitchen_action.JointVelocity: VelocityEncoder,
        kitchen_action.KitchenJointPosition: KitchenPositionEncoder,
        joint_modes.JointOffset: OffsetEncoder,
        joint_modes.JointPosition: PositionEncoder,
        joint_modes.JointDelta: DeltaEncoder,
        end_effector.EndEffectorDeltaPosition: DeltaPositionEncoder,
        end_effector.EndEffectorDeltaPose: DeltaPoseEncoder,
        end_effector.EndEffectorPose: PoseEncoder,
    }
)


def make_encoder(mode: ActionMode, arm: ArmModel) -> ActionEncoder:
    """Builds the encoder of a control mode, an instance of one of the classes in `ENCODERS`."""
    if type(mode) not in ENCODERS:
        names = ", ".join(dict.fromkeys(each.name for each in ENCODERS))
        raise ValueError(f"the experts cannot act in control_mode {mode.name!r}, only in {names} of the suite's own")
    return ENCODERS[type(mode)](mode, arm)

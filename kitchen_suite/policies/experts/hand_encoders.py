"""Action encoders of the modes that command the pose of the end effector."""

import abc
from typing import NamedTuple

import mink
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.experts.encoders import ActionEncoder, ArmModel, gripper_action
from kitchen_suite.policies.experts.kinematics import ARM
from kitchen_suite.policies.experts.trajectories import hand_speed_limits
from kitchen_suite.tasks.control_modes import poses
from kitchen_suite.tasks.control_modes.end_effector import (
    COMMAND_ANGLE,
    COMMAND_DISTANCE,
    REACH,
    EndEffectorDeltaPose,
    EndEffectorDeltaPosition,
    EndEffectorPose,
)

# A hand farther than this from its target [m, rad] does not follow.
_MAX_DISTANCE, _MAX_ANGLE = 0.1, 0.5

# Fraction of the mode's speeds at which trajectories move, so that actions can still correct errors.
_SPEED_RESERVE = 0.9

# Greatest speeds of the hand in `ee_pose`, and angular speed in `ee_delta_position` [m/s, rad/s]: the defaults of the
# modes that have speeds.
_LINEAR_SPEED, _ANGULAR_SPEED = 0.25, 1.0


class _Pose(NamedTuple):
    """Position `(3,)` [m] and orientation `(4,)`, as quaternion w, x, y, z."""

    position: NDArray[np.float64]
    orientation: NDArray[np.float64]

    @classmethod
    def of(cls, transform: mink.SE3) -> "_Pose":
        """The pose that a transform takes the world's frame to."""
        return cls(position=transform.translation(), orientation=transform.wxyz_xyz[:4])

    def moved(self, offset: NDArray[np.float64], turn: NDArray[np.float64]) -> "_Pose":
        """This pose, displaced by an offset `(3,)` [m] and turned by a rotation vector `(3,)` of the world."""
        return _Pose(self.position + offset, poses.product(poses.quaternion(turn), self.orientation))

    def error(self, target: "_Pose") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Offset `(3,)` [m] and rotation vector `(3,)` that bring this pose to a target, in the world."""
        return target.position - self.position, poses.difference(target.orientation, self.orientation)

    def near(self, hand: "_Pose") -> "_Pose":
        """This pose, brought as near to the hand as commanded poses are."""
        offset, turn = hand.error(self)
        return hand.moved(poses.within(offset, COMMAND_DISTANCE), poses.within(turn, COMMAND_ANGLE))


class HandEncoder(ActionEncoder):
    """An encoder of a mode that commands the hand's pose; the mode chooses the posture of the arm."""

    def __init__(
        self, arm: ArmModel, *, linear_speed: float = _LINEAR_SPEED, angular_speed: float = _ANGULAR_SPEED
    ) -> None:
        """Sets the speed limits [m/s, rad/s]."""
        super().__init__(arm)
        self._base = _Pose.of(arm.kinematics.base)
        self.limits = hand_speed_limits(
            arm.kinematics,
            tuple(arm.joint_speed),
            arm.timestep,
            linear_speed=_SPEED_RESERVE * linear_speed,
            angular_speed=_SPEED_RESERVE * angular_speed,
        )

    def follows(self, joints: NDArray[np.float64], target: NDArray[np.float64]) -> bool:
        offset, turn = self._pose(joints).error(self._pose(target))
        return bool(poses.length(offset)[0] < _MAX_DISTANCE and poses.length(turn)[0] < _MAX_ANGLE)

    def encode(
        self, positions: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        hand = self._pose(positions[ARM])
        offset, turn = (error / self._arm.hand_response for error in hand.error(self._pose(target)))
        return np.append(self._encode_pose(hand.moved(offset, turn).near(hand)), gripper_action(fingers))

    def _pose(self, joints: NDArray[np.float64]) -> _Pose:
        """Pose of the hand at joint positions `(7,)` [rad]."""
        return _Pose.of(self._arm.kinematics.forward(joints))

    @abc.abstractmethod
    def _encode_pose(self, pose: _Pose) -> NDArray[np.float64]:
        """Returns the elements of the action that command a pose."""


class PoseEncoder(HandEncoder):
    """Encoder of `ee_pose`."""

    arm_size = 7

    def __init__(self, mode: EndEffectorPose, arm: ArmModel) -> None:
        del mode
        super().__init__(arm)

    def _encode_pose(self, pose: _Pose) -> NDArray[np.float64]:
        to_base = poses.inverse(self._base.orientation)
        position = poses.rotated(to_base, pose.position - self._base.position) / REACH
        return np.append(position, poses.product(to_base, pose.orientation))


class _DeltaEncoder(HandEncoder):
    """An encoder of a mode that changes the commanded pose; it keeps account of that pose."""

    def __init__(
        self, mode: EndEffectorDeltaPosition | EndEffectorDeltaPose, arm: ArmModel, *, angular_speed: float
    ) -> None:
        super().__init__(arm, linear_speed=mode.linear_speed, angular_speed=angular_speed)
        self._frame, self._step = mode.frame, mode.linear_speed * arm.timestep

    def reset(self, joints: NDArray[np.float64]) -> None:
        self._commanded = self._pose(joints)

    def _axes(self) -> NDArray[np.float64]:
        """Orientation `(4,)` of the frame of the action."""
        return self._base.orientation if self._frame == "base" else self._commanded.orientation

    def _encode_pose(self, pose: _Pose) -> NDArray[np.float64]:
        return poses.rotated(poses.inverse(self._axes()), pose.position - self._commanded.position) / self._step


class DeltaPositionEncoder(_DeltaEncoder):
    """Encoder of `ee_delta_position`."""

    turns_hand = False
    arm_size = 3

    def __init__(self, mode: EndEffectorDeltaPosition, arm: ArmModel) -> None:
        super().__init__(mode, arm, angular_speed=_ANGULAR_SPEED)

    def applied(self, positions: NDArray[np.float64], action: NDArray[np.float64]) -> None:
        offset = poses.rotated(self._axes(), self._step * action[:3])
        moved = self._commanded._replace(position=self._commanded.position + offset)
        self._commanded = moved.near(self._pose(positions[ARM]))._replace(orientation=moved.orientation)


class DeltaPoseEncoder(_DeltaEncoder):
    """Encoder of `ee_delta_pose`."""

    arm_size = 6

    def __init__(self, mode: EndEffectorDeltaPose, arm: ArmModel) -> None:
        super().__init__(mode, arm, angular_speed=mode.angular_speed)
        self._turn = mode.angular_speed * arm.timestep

    def applied(self, positions: NDArray[np.float64], action: NDArray[np.float64]) -> None:
        axes = self._axes()
        moved = self._commanded.moved(
            poses.rotated(axes, self._step * action[:3]), poses.rotated(axes, self._turn * action[3:6])
        )
        self._commanded = moved.near(self._pose(positions[ARM]))

    def _encode_pose(self, pose: _Pose) -> NDArray[np.float64]:
        turn = poses.difference(pose.orientation, self._commanded.orientation)
        rotation = poses.rotated(poses.inverse(self._axes()), turn) / self._turn
        return np.append(super()._encode_pose(pose), rotation)

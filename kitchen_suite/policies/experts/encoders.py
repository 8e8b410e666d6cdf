"""Action encoders: they turn the joint positions that an expert plans into actions of a control mode."""

import abc
import dataclasses
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.policies.experts.skills import OPEN
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits


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
    gains: NDArray[np.float64]
    joint_response: NDArray[np.float64] | float
    hand_response: float
    joint_speed: Sequence[float]
    timestep: float

    def gravity_offset(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Offsets `(7,)` of servo targets that hold the arm at joint positions `(7,)` [rad]."""
        return self.kinematics.gravity(joints) / self.gains

    def servo_targets(self, joints: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Servo targets `(7,)` that move the arm from joint positions `(7,)` to a target `(7,)` and hold it [rad]."""
        return self.led(joints, target) + self.gravity_offset(joints)

    def led(self, joints: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint positions `(7,)` that lead the target as far as the joints would lag behind it [rad]."""
        return joints + (target - joints) / self.joint_response


class ActionEncoder(abc.ABC):
    """Turns targets of joints and fingers into actions of one control mode.

    Attributes:
      turns_hand: whether actions can turn the hand; otherwise it keeps its orientation at the reset.
      limits: speeds that the mode can follow.
      low, high: bounds of the action's elements.
      arm_size: number of the action's leading elements that move the arm; the others move the fingers.
    """

    turns_hand: ClassVar[bool] = True

    limits: JointSpeedLimits
    low: ArrayLike = -1.0
    high: ArrayLike = 1.0
    arm_size: int = 7

    def __init__(self, arm: ArmModel) -> None:
        self._arm = arm

    def reset(self, joints: NDArray[np.float64]) -> None:  # noqa: B027
        """Begins an episode at joint positions `(7,)` [rad]."""

    @abc.abstractmethod
    def follows(self, joints: NDArray[np.float64], target: NDArray[np.float64]) -> bool:
        """Returns whether the arm, at joint positions `(7,)`, is near its target `(7,)` [rad]."""

    @abc.abstractmethod
    def encode(
        self, positions: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        """Returns the action that moves joints and fingers to their targets within a control step, before clipping.

        Args:
          positions: observed positions of the robot's joints, those of the arm first [rad, m].
          target: `(7,)`, target of the arm's joints [rad].
          fingers: target of each finger [m].
        """

    def applied(self, positions: NDArray[np.float64], action: NDArray[np.float64]) -> None:  # noqa: B027
        """Updates what the mode remembers from an action that is applied.

        Args:
          positions: observed positions of the robot's joints before it [rad, m].
          action: the action, within its bounds.
        """


def gripper_action(fingers: float) -> float:
    """Returns the gripper's element of an action for an opening of each finger [m]: +1 closed, -1 open."""
    return 1.0 - 2.0 * fingers / OPEN

"""Action encoders of the modes that command joints."""

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.policies.experts.encoders import ActionEncoder, ArmModel, gripper_action
from kitchen_suite.policies.experts.kinematics import ARM
from kitchen_suite.policies.experts.skills import CLOSED
from kitchen_suite.policies.experts.trajectories import joint_speed_limits
from kitchen_suite.tasks.control_modes.joint_offset import JOINT_HIGH, JOINT_LOW, JointOffset
from kitchen_suite.tasks.control_modes.joints import TARGET_DISTANCE, JointDelta, JointPosition
from kitchen_suite.tasks.kitchen import action as kitchen_action

# A joint farther than this from its target [rad] does not follow.
_MAX_LAG = 0.25

# The velocity scale for which the joint speeds hold: velocity of a joint for an action of one [rad/s].
_VELOCITY_SCALE = 2.0

# Fraction of `joint_speed` at which trajectories move, so that actions can still correct errors.
_SPEED_RESERVE = 0.9

# Gripper logit at which the gripper closes almost surely.
_CLOSE_LOGIT = 50.0


class JointEncoder(ActionEncoder):
    """An encoder of a mode that commands joints."""

    def __init__(self, arm: ArmModel, *, speed: float = np.inf, scale: float = 1.0) -> None:
        """Sets the speed limits.

        Args:
          arm: the robot.
          speed: greatest speed of any joint in the mode [rad / control step].
          scale: factor of the joint speeds.
        """
        super().__init__(arm)
        self.limits = joint_speed_limits(
            tuple(min(float(each), speed) for each in np.array(arm.joint_speed) * scale), arm.timestep
        )

    def follows(self, joints: NDArray[np.float64], target: NDArray[np.float64]) -> bool:
        return bool(np.max(np.abs(target - joints)) < _MAX_LAG)


class VelocityEncoder(JointEncoder):
    """Encoder of the kitchen's `joint_velocity`."""

    def __init__(self, mode: kitchen_action.JointVelocity, arm: ArmModel) -> None:
        scale = checks.number(mode.velocity_scale, "velocity_scale", positive=True)
        super().__init__(arm, scale=min(1.0, scale / _VELOCITY_SCALE))
        self._mode = mode

    def reset(self, joints: NDArray[np.float64]) -> None:
        # The last position target, if the next one is relative to it.
        self._commanded: NDArray[np.float64] | None = None

    def encode(
        self, positions: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        commanded = np.append(self._arm.servo_targets(positions[ARM], target), [fingers, fingers])
        return (commanded - self._base_positions(positions)) / (self._mode.velocity_scale * self._arm.timestep)

    def applied(self, positions: NDArray[np.float64], action: NDArray[np.float64]) -> None:
        if self._mode.feedback == "target":
            unit = {"velocity_scale": self._mode.velocity_scale, "timestep": self._arm.timestep}
            self._commanded = kitchen_action.position_target(self._base_positions(positions), action, **unit)

    def _base_positions(self, observed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Robot positions `(9,)` to which the environment adds the action, given the observed ones [rad, m]."""
        return observed if self._commanded is None else self._commanded


class PositionEncoder(JointEncoder):
    """Encoder of `joint_position`."""

    low, high = JOINT_LOW, JOINT_HIGH

    def __init__(self, mode: JointPosition | kitchen_action.JointPosition, arm: ArmModel) -> None:
        del mode
        super().__init__(arm)

    def encode(
        self, positions: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        arm = self._arm.servo_targets(positions[ARM], target)
        return np.append(arm, [fingers] * (self.low.size - arm.size))


class KitchenPositionEncoder(PositionEncoder):
    """Encoder of the kitchen's `joint_position`."""

    low, high = kitchen_action.POSITION_LOW, kitchen_action.POSITION_HIGH


class OffsetEncoder(JointEncoder):
    """Encoder of `joint_offset`."""

    low, high = -np.inf, np.inf

    def __init__(self, mode: JointOffset, arm: ArmModel) -> None:
        del mode
        super().__init__(arm)

    def encode(
        self, positions: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        joints = positions[ARM]
        offset = (target - joints) / self._arm.joint_response + self._arm.gravity_offset(joints)
        return np.append(offset, _CLOSE_LOGIT if fingers == CLOSED else -_CLOSE_LOGIT)


class DeltaEncoder(JointEncoder):
    """Encoder of `joint_delta`; it keeps account of the commanded joint positions."""

    def __init__(self, mode: JointDelta, arm: ArmModel) -> None:
        self._step = mode.joint_speed * arm.timestep
        super().__init__(arm, speed=_SPEED_RESERVE * self._step)

    def reset(self, joints: NDArray[np.float64]) -> None:
        self._commanded = joints

    def encode(
        self, positions: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        change = self._arm.led(positions[ARM], target) - self._commanded
        return np.append(change / self._step, gripper_action(fingers))

    def applied(self, positions: NDArray[np.float64], action: NDArray[np.float64]) -> None:
        joints, commanded = positions[ARM], self._commanded + self._step * action[ARM]
        self._commanded = np.clip(commanded, joints - TARGET_DISTANCE, joints + TARGET_DISTANCE)

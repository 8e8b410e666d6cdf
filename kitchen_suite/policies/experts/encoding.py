"""The table of action encoders by control mode."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite.policies.experts import hand_encoders, joint_encoders
from kitchen_suite.policies.experts.encoders import ActionEncoder, ArmModel
from kitchen_suite.tasks.control_modes import end_effector, joint_offset, joints
from kitchen_suite.tasks.kitchen import action
from kitchen_suite.tasks.mdp import ActionMode

ENCODERS: Mapping[type[ActionMode], Callable[[Any, ArmModel], ActionEncoder]] = MappingProxyType(
    {
        action.JointVelocity: joint_encoders.VelocityEncoder,
        action.JointPosition: joint_encoders.KitchenPositionEncoder,
        joint_offset.JointOffset: joint_encoders.OffsetEncoder,
        joints.JointPosition: joint_encoders.PositionEncoder,
        joints.JointDelta: joint_encoders.DeltaEncoder,
        end_effector.EndEffectorDeltaPosition: hand_encoders.DeltaPositionEncoder,
        end_effector.EndEffectorDeltaPose: hand_encoders.DeltaPoseEncoder,
        end_effector.EndEffectorPose: hand_encoders.PoseEncoder,
    }
)


def make_encoder(mode: ActionMode, arm: ArmModel) -> ActionEncoder:
    """Builds the encoder of a control mode.

    Args:
      mode: an instance of one of the classes in `ENCODERS`.
      arm: the robot and its control.

    Raises:
      ValueError: there is no encoder for the mode.
    """
    if type(mode) not in ENCODERS:
        names = ", ".join(each.__name__ for each in ENCODERS)
        raise ValueError(f"the experts cannot act in control mode {type(mode).__name__}, only in {names}")
    return ENCODERS[type(mode)](mode, arm)

"""The kitchen's arm, as its expert plans for it: kinematics, and how fast its actuators follow."""

import functools

import numpy as np

from kitchen_suite.entities import KITCHEN_FRANKA, KitchenArena
from kitchen_suite.policies.experts.encoders import ArmModel
from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.tasks.kitchen.action import CONTROL_TIMESTEP

_ACTUATORS = tuple(link.actuator for link in KITCHEN_FRANKA.links)
_GAINS = np.array([actuator.gain for actuator in _ACTUATORS])
# Fraction of a joint's position error that its actuator removes in a control step: gain and damping of the joint make a
# first-order lag.
_RESPONSE = 1.0 - np.exp(-CONTROL_TIMESTEP * _GAINS / np.array([actuator.damping for actuator in _ACTUATORS]))

# Joint speeds that the actuators can follow [rad / control step]. The shoulder's limit is 0.06: its torque limit less
# the torque of gravity.
_JOINT_SPEED = (0.06,) * 4 + (0.08,) * 3

# Fraction of the hand's error that the control modes of the end effector remove in a control step.
_HAND_RESPONSE = 0.55


@functools.cache
def arm_model() -> ArmModel:
    """The arm in the kitchen, shared by all instances."""
    return ArmModel(
        kinematics=ArmKinematics(KitchenArena, KITCHEN_FRANKA),
        gains=_GAINS,
        joint_response=_RESPONSE,
        hand_response=_HAND_RESPONSE,
        joint_speed=_JOINT_SPEED,
        timestep=CONTROL_TIMESTEP,
    )

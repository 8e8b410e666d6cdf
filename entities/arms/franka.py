"""The Franka Panda with its two-finger hand, as in FrankaKitchen-v1 and as published."""

import functools
import math

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import assets
from kitchen_suite.entities.robot import RobotSpec
from kitchen_suite.types import Vector

_CLOSED = 0.0  # Target of the fingers that closes the hand [m].
_OPEN = 0.04  # Target of the fingers that opens the hand [m].


def _load(name: str, *, visuals: bool) -> mjcf.RootElement:
    """Parses `xml/<name>.xml`; the visual geoms stay in the bodies of the links."""
    model = assets.parse_mjcf(name)
    if not visuals:
        assets.remove_visuals(model)
    return model


_KITCHEN_HOME = {
    "panda0_joint1": 0.148388023,
    "panda0_joint2": -1.76848573,
    "panda0_joint3": 1.84390296,
    "panda0_joint4": -2.4768576,
    "panda0_joint5": 0.260252026,
    "panda0_joint6": 0.712533105,
    "panda0_joint7": 1.59515394,
    "panda0_finger_joint1": 0.0479267505,
    "panda0_finger_joint2": 0.0371350919,
}
_KITCHEN_JOINTS = tuple(_KITCHEN_HOME)

KITCHEN_FRANKA = RobotSpec(
    name="franka",
    load=functools.partial(_load, "kitchen_franka"),
    servos={joint: joint for joint in _KITCHEN_JOINTS[:7]},
    hand_actuators=_KITCHEN_JOINTS[7:],
    closed=_CLOSED,
    open=_OPEN,
    # As in FrankaKitchen-v1 [rad, m].
    home=_KITCHEN_HOME,
    fingers=_KITCHEN_JOINTS[7:],
    pads=("left_finger_rung_0a", "right_finger_rung_0a"),
    physics_options={},
)
"""The Franka of FrankaKitchen-v1."""

_PANDA_HOME = {
    "joint1": math.radians(0.0),
    "joint2": math.radians(-30.0),
    "joint3": math.radians(0.0),
    "joint4": math.radians(-156.0),
    "joint5": math.radians(0.0),
    "joint6": math.radians(186.0),
    "joint7": math.radians(-45.0),
    "finger_joint1": _OPEN,
    "finger_joint2": _OPEN,
}
_PANDA_JOINTS = tuple(_PANDA_HOME)

PANDA = RobotSpec(
    name="franka",
    load=functools.partial(_load, "panda"),
    servos={joint: joint for joint in _PANDA_JOINTS[:7]},
    hand_actuators=_PANDA_JOINTS[7:],
    closed=_CLOSED,
    open=_OPEN,
    # The hand before the robot, and open [rad, m].
    home=_PANDA_HOME,
    end_effector="gripper",
    fingers=_PANDA_JOINTS[7:],
    pads=("left_finger_pad", "right_finger_pad"),
    physics_options={},
)
"""The Franka Emika Panda, in its own joint convention."""

# The Panda's MJCF without its meshes: for numbers that are needed before there is a robot.
PANDA_MODEL = assets.parse_without_meshes("panda")

# Least and greatest position `(2, 9)` of the Panda's joints [rad, m]; read-only.
PANDA_JOINT_LIMITS = np.transpose([PANDA_MODEL.joint(joint).range for joint in _PANDA_JOINTS]).copy()
PANDA_JOINT_LIMITS.flags.writeable = False

# Half sizes of the Panda's pads: along the bar that they hold, in the direction of closing, along the finger [m].
PAD_HALF_SIZE: Vector = tuple(PANDA_MODEL.geom(PANDA.pads[0]).size.tolist())

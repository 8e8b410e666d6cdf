"""The robots that the suite has, and a user's own."""

import functools
import hashlib

from kitchen_suite import checks, imports
from kitchen_suite.entities.arms.franka import KITCHEN_FRANKA
from kitchen_suite.entities.robot import Robot, RobotSpec

FRANKA = "franka"  # Name of the robot of FrankaKitchen-v1, the default.


def robot_spec(robot: str | RobotSpec) -> RobotSpec:
    """Returns the specification of a robot: `franka`, or a user's own, itself or as `module:NAME`.

    Raises a ValueError if there is no such robot, and a TypeError for what names none.
    """
    if isinstance(robot, RobotSpec):
        return robot
    if robot == FRANKA:
        return KITCHEN_FRANKA
    if not isinstance(robot, str):
        raise TypeError(f"robot must be a string or a RobotSpec, got {checks.shown(robot)}")
    if ":" not in robot:
        own = "or your own, a RobotSpec or 'module:NAME'"
        raise ValueError(f"robot {checks.shown(robot)} does not exist; choose {FRANKA!r}, {own}")
    specification = imports.named(robot, "robot")
    if not isinstance(specification, RobotSpec):
        raise ValueError(f"robot {checks.shown(robot)} must be a RobotSpec, got {checks.shown(specification)}")
    return specification


@functools.cache
def model_digest(robot: str) -> str:
    """Returns the first 16 hexadecimal digits of the SHA-256 of the MJCF of a named robot, without visual geoms.

    It depends on the meshes as well, since their names in the MJCF have digests of their contents.
    """
    text = make_robot(robot, visuals=False).mjcf_model.to_xml_string()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def make_robot(robot: str | RobotSpec, *, visuals: bool = True) -> Robot:
    """Builds a robot; see `robot_spec`."""
    return Robot(robot_spec(robot), visuals=visuals)

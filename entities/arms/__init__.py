"""The robots that the suite has, by name."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite import checks, imports
from kitchen_suite.entities.arms.franka import KITCHEN_FRANKA
from kitchen_suite.entities.arms.panda_2f85 import PANDA_2F85
from kitchen_suite.entities.arms.ur5e import UR5E
from kitchen_suite.entities.robot import Robot, RobotSpec

FRANKA = "franka"  # Name of the robot of FrankaKitchen-v1, the default.

ROBOTS: Mapping[str, RobotSpec] = MappingProxyType({FRANKA: KITCHEN_FRANKA, "panda": PANDA_2F85, "ur5e": UR5E})
"""Robots of the kitchen by name."""


def robot_spec(robot: str | RobotSpec) -> RobotSpec:
    """Returns the specification of a robot: a key of `ROBOTS`, or a user's own, itself or as `module:NAME`.

    Raises a ValueError if there is no such robot.
    """
    if isinstance(robot, RobotSpec):
        return robot
    if not (isinstance(robot, str) and ":" in robot):
        return ROBOTS[checks.choice(robot, ROBOTS, "robot")]
    specification = imports.named(robot, "robot")
    if not isinstance(specification, RobotSpec):
        raise ValueError(f"robot {checks.shown(robot)} must be a RobotSpec, got {checks.shown(specification)}")
    return specification


def make_robot(robot: str | RobotSpec, *, visuals: bool = True) -> Robot:
    """Builds a robot; see `robot_spec`. Raises an ImportError if the package with its model is missing."""
    return Robot(robot_spec(robot), visuals=visuals)

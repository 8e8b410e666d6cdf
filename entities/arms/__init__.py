"""Arms by name, each in a module of its own, whose models come from packages and folders of the user's."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite import checks
from kitchen_suite.entities.franka import Franka
from kitchen_suite.entities.robot import Arm, ArmSpec, Robot

FRANKA = "franka"  # Name of the robot of FrankaKitchen-v1, the default.

ARMS: Mapping[str, str] = MappingProxyType(
    {name: f"kitchen_suite.entities.arms.{name}:{name.upper()}" for name in ("panda", "ur5e", "fr3", "xarm7")}
)
"""Entry points of the specifications of other arms by name."""


def make_robot(robot: str | ArmSpec, *, visuals: bool = True) -> Robot:
    """Builds a robot: `franka`, a key of `ARMS`, or an `ArmSpec` of the user's own, itself or as `module:NAME`.

    Raises:
      ValueError: there is no such robot.
      ImportError: the package with its model is missing.
    """
    if robot == FRANKA:
        return Franka(visuals=visuals)
    specification: object = robot
    if not isinstance(robot, ArmSpec):
        is_own = isinstance(robot, str) and ":" in robot
        specification = checks.imported(
            robot if is_own else ARMS[checks.choice(robot, (FRANKA, *ARMS), "robot")], "robot"
        )
    if not isinstance(specification, ArmSpec):
        raise ValueError(f"robot {checks.shown(robot)} must be an ArmSpec, got {checks.shown(specification)}")
    return Arm(specification, visuals=visuals)

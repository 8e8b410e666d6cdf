"""The UFACTORY xArm7 with its gripper, from MuJoCo Menagerie. Nobody has tried it in the kitchen yet."""

import functools

from kitchen_suite.entities.robot import ArmSpec, load_menagerie_mjcf

_SERVOS = {f"joint{number}": f"act{number}" for number in range(1, 8)}

XARM7 = ArmSpec(
    name="xarm7",
    arm=functools.partial(load_menagerie_mjcf, "ufactory_xarm7", "xarm7.xml", "xarm7"),
    servos=_SERVOS,
    hand_actuators=("gripper",),
    closed=255.0,
    open=0.0,
    tool="xarm_gripper_base_link",
    tool_pos=(0.0, 0.0, 0.125),
    # By the published lengths of its links, the hand is where the Franka's is.
    home=dict(zip(_SERVOS, (-1.7606, -1.0199, -2.3568, 1.2876, -1.4712, 2.3414, -0.3086), strict=True)),
    # Its reach is less.
    base_pos=(0.1, 0.0, 0.0),
)

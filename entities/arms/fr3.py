"""The Franka FR3 with the Franka hand, from MuJoCo Menagerie. Nobody has tried it in the kitchen yet."""

import functools

from kitchen_suite.entities.robot import ArmSpec, load_menagerie_mjcf

_SERVOS = {f"fr3_joint{number}": f"fr3_joint{number}" for number in range(1, 8)}

FR3 = ArmSpec(
    name="fr3",
    arm=functools.partial(load_menagerie_mjcf, "franka_fr3", "fr3.xml", "fr3"),
    hand=functools.partial(load_menagerie_mjcf, "franka_emika_panda", "hand.xml", "fr3"),
    servos=_SERVOS,
    hand_actuators=("panda hand/actuator8",),
    closed=0.0,
    open=255.0,
    tool="panda hand/hand",
    tool_pos=(0.0, 0.0, 0.075),
    # By the published lengths of its links, the hand is where that of the kitchen's Franka is.
    home={
        **dict(zip(_SERVOS, (-0.1535, -0.9313, 1.8788, -2.4513, -0.8281, 2.1155, -0.7525), strict=True)),
        "panda hand/finger_joint1": 0.04,
        "panda hand/finger_joint2": 0.04,
    },
)

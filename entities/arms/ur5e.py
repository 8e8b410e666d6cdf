"""The Universal Robots UR5e with a Robotiq 2F-85 hand, from the package ogbench."""

import functools

from kitchen_suite.entities.robot import ArmSpec, load_package_mjcf

_SERVOS = {
    f"{name}_joint": name for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
}
_FOLDER = "manipspace/descriptions"

UR5E = ArmSpec(
    name="ur5e",
    arm=functools.partial(load_package_mjcf, "ogbench", f"{_FOLDER}/universal_robots_ur5e/ur5e.xml", "ur5e"),
    hand=functools.partial(load_package_mjcf, "ogbench", f"{_FOLDER}/robotiq_2f85/2f85.xml", "ur5e"),
    servos=_SERVOS,
    hand_actuators=("robotiq_2f85/fingers_actuator",),
    closed=255.0,
    open=0.0,
    tool="robotiq_2f85/base",
    tool_pos=(0.0, 0.0, 0.12),
    # The hand is where the Franka's is.
    home=dict(zip(_SERVOS, (-2.7055, -2.8021, -1.856, 1.4095, -0.5114, 0.0617), strict=True)),
    # On a plinth, so that its shoulder is as high as the Franka's, a little further from the counter.
    base_pos=(-0.05, 0.0, 0.2),
)

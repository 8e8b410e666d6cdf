"""The Universal Robots UR5e with a Robotiq 2F-85 hand, from the package ogbench."""

from pathlib import Path

from dm_control import mjcf

from kitchen_suite.entities.robot import ArmSpec, load_mjcf, package_folder

_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def _folder() -> Path:
    return package_folder("ogbench", "pip install 'kitchen-suite[arms]'") / "manipspace" / "descriptions"


def _arm() -> mjcf.RootElement:
    return load_mjcf(_folder() / "universal_robots_ur5e" / "ur5e.xml")


def _hand() -> mjcf.RootElement:
    return load_mjcf(_folder() / "robotiq_2f85" / "2f85.xml")


UR5E = ArmSpec(
    name="ur5e",
    arm=_arm,
    hand=_hand,
    servos={f"{joint}_joint": joint for joint in _JOINTS},
    hand_actuators=("robotiq_2f85/fingers_actuator",),
    closed=255.0,
    open=0.0,
    tool="robotiq_2f85/base",
    tool_pos=(0.0, 0.0, 0.12),
    tool_quat=(1.0, 0.0, 0.0, 0.0),
    home={f"{joint}_joint": 0.0 for joint in _JOINTS},
)

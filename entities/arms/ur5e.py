"""The Universal Robots UR5e with a Robotiq 2F-85 hand, from the package ogbench."""

from dm_control import mjcf

from kitchen_suite.entities.robot import RobotSpec, load_package_mjcf

_FOLDER = "manipspace/descriptions"


def _load(*, visuals: bool) -> mjcf.RootElement:
    arm = load_package_mjcf("ogbench", f"{_FOLDER}/universal_robots_ur5e/ur5e.xml", "ur5e", visuals=visuals)
    hand = load_package_mjcf("ogbench", f"{_FOLDER}/robotiq_2f85/2f85.xml", "ur5e", visuals=visuals)
    hand.find("body", "base").add("site", name="end_effector", pos=(0.0, 0.0, 0.12), size=(0.01,), group=5)
    arm.find("site", "attachment_site").attach(hand)
    return arm


UR5E = RobotSpec(
    name="ur5e",
    load=_load,
    servos={
        "shoulder_pan_joint": "shoulder_pan",
        "shoulder_lift_joint": "shoulder_lift",
        "elbow_joint": "elbow",
        "wrist_1_joint": "wrist_1",
        "wrist_2_joint": "wrist_2",
        "wrist_3_joint": "wrist_3",
    },
    hand_actuators=("robotiq_2f85/fingers_actuator",),
    closed=255.0,
    open=0.0,
    # The hand is where the Franka's is.
    home={
        "shoulder_pan_joint": -2.7055,
        "shoulder_lift_joint": -2.8021,
        "elbow_joint": -1.856,
        "wrist_1_joint": 1.4095,
        "wrist_2_joint": -0.5114,
        "wrist_3_joint": 0.0617,
    },
    end_effector="robotiq_2f85/end_effector",
    # On a plinth, so that its shoulder is as high as the Franka's, a little further from the counter.
    base_pos=(-0.05, 0.0, 0.2),
)

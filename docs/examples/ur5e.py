"""The Universal Robots UR5e with a Robotiq 2F-85 hand in the kitchen, with the scripted expert.

Run: python ur5e.py. It needs the extra `experts`, and for the models of arm and hand: pip install ogbench.
"""

import numpy as np

from kitchen_suite import experts, suite
from kitchen_suite.entities import RobotSpec
from kitchen_suite.entities.robot import load_package_mjcf

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
from dm_control import mjcf

FOLDER = "manipspace/descriptions"


def load(*, visuals: bool) -> mjcf.RootElement:
    """Returns the arm with the hand attached, which are two files."""
    arm = load_package_mjcf("ogbench", f"{FOLDER}/universal_robots_ur5e/ur5e.xml", visuals=visuals)
    hand = load_package_mjcf("ogbench", f"{FOLDER}/robotiq_2f85/2f85.xml", visuals=visuals)
    hand.find("body", "base").add("site", name="end_effector", pos=(0.0, 0.0, 0.12), size=(0.01,), group=5)
    arm.find("site", "attachment_site").attach(hand)
    return arm


UR5E = RobotSpec(
    name="ur5e",
    load=load,
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
    # The hand is where the Franka's is [rad].
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

if __name__ == "__main__":
    arguments = {"robot": UR5E, "control_mode": "ee_delta_pose", "random": 0, "visuals": False}
    environment = suite.load("kitchen", "kettle", arguments)
    policy = experts.make_policy(environment, np.random.default_rng(0))
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))
    print(timestep.observation["ur5e/joint_positions"].shape, environment.task.completion_steps)

"""The Franka Panda with a Robotiq 2F-85 hand in the kitchen, with the scripted expert.

Run: python panda.py. It needs the extra `experts`, and for the model: pip install --no-deps gym-hil. Without --no-deps
that package would install an older MuJoCo than the suite needs; only its MJCF is read.
"""

import numpy as np

from kitchen_suite import experts, suite
from kitchen_suite.entities import RobotSpec
from kitchen_suite.entities.robot import load_package_mjcf

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
from dm_control import mjcf

# Joints from the base outwards, and where they start: the hand is where the Franka's is [rad].
HOME = {
    "joint1": -0.0893,
    "joint2": -0.9113,
    "joint3": 1.9231,
    "joint4": -2.4063,
    "joint5": -0.75,
    "joint6": 2.0054,
    "joint7": -0.0025,
}

# Servos of MuJoCo Menagerie's Panda: gain [N m/rad], damping [N m s/rad], and greatest torque [N m].
SERVOS = {
    "joint1": (4500.0, 450.0, 87.0),
    "joint2": (4500.0, 450.0, 87.0),
    "joint3": (3500.0, 350.0, 87.0),
    "joint4": (3500.0, 350.0, 87.0),
    "joint5": (2000.0, 200.0, 12.0),
    "joint6": (2000.0, 200.0, 12.0),
    "joint7": (2000.0, 200.0, 12.0),
}


def load(*, visuals: bool) -> mjcf.RootElement:
    """Returns the arm and its hand, with position servos in place of the motors of gym-hil's arm."""
    model = load_package_mjcf("gym_hil", "assets/panda.xml", visuals=visuals)
    for joint, (gain, damping, torque) in SERVOS.items():
        name = joint.replace("joint", "actuator")
        model.find("actuator", name).remove()
        model.actuator.add(
            "position",
            name=name,
            joint=joint,
            kp=gain,
            kv=damping,
            forcerange=(-torque, torque),
            inheritrange=1.0,  # Targets within the joint's range.
        )
    model.find("body", "base").add(
        "site", name="end_effector", pos=(0.0, 0.0, 0.12), quat=(0.0, 0.0, 0.0, 1.0), size=(0.01,), group=5
    )
    return model


PANDA_2F85 = RobotSpec(
    name="panda",
    load=load,
    servos={joint: joint.replace("joint", "actuator") for joint in HOME},
    hand_actuators=("fingers_actuator",),
    closed=255.0,
    open=0.0,
    home=HOME,
)

if __name__ == "__main__":
    arguments = {"robot": PANDA_2F85, "control_mode": "ee_delta_pose", "random": 0, "visuals": False}
    environment = suite.load("kitchen", "kettle", arguments)
    policy = experts.make_policy(environment, np.random.default_rng(0))
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))
    print(timestep.observation["panda/joint_positions"].shape, environment.task.completion_steps)

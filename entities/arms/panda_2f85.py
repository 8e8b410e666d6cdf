"""The Franka Panda with a Robotiq 2F-85 hand, from the package gym-hil; servos as of the published model."""

from dm_control import mjcf

from kitchen_suite.entities.arms.franka import PANDA_MODEL
from kitchen_suite.entities.robot import RobotSpec, load_package_mjcf

_HOME = {
    "joint1": -0.0893,
    "joint2": -0.9113,
    "joint3": 1.9231,
    "joint4": -2.4063,
    "joint5": -0.75,
    "joint6": 2.0054,
    "joint7": -0.0025,
}


def _load(*, visuals: bool) -> mjcf.RootElement:
    # Without what gym-hil needs, which wants an older MuJoCo.
    install = "pip install --no-deps 'gym-hil>=0.1.14'"
    model = load_package_mjcf("gym_hil", "assets/panda.xml", "panda", install, visuals=visuals)
    # Its arm has motors in place of position servos.
    for joint in _HOME:
        servo = PANDA_MODEL.actuator(joint)
        name = joint.replace("joint", "actuator")
        model.find("actuator", name).remove()
        model.actuator.add(
            "position",
            name=name,
            joint=joint,
            kp=servo.gainprm[0],
            kv=-servo.biasprm[2],
            forcerange=servo.forcerange,
            ctrlrange=servo.ctrlrange,
        )
    model.find("body", "base").add(
        "site", name="end_effector", pos=(0.0, 0.0, 0.12), quat=(0.0, 0.0, 0.0, 1.0), size=(0.01,), group=5
    )
    return model


PANDA_2F85 = RobotSpec(
    name="panda",
    load=_load,
    servos={joint: joint.replace("joint", "actuator") for joint in _HOME},
    hand_actuators=("fingers_actuator",),
    closed=255.0,
    open=0.0,
    # The hand is where the Franka's is.
    home=_HOME,
)

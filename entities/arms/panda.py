"""The Franka Panda with a Robotiq 2F-85 hand, from the package gym-hil; servos as of the published model."""

from dm_control import mjcf

from kitchen_suite.entities.franka_specs import PANDA as PUBLISHED
from kitchen_suite.entities.robot import ArmSpec, load_package_mjcf

_SERVOS = {f"joint{number}": f"actuator{number}" for number in range(1, 8)}


def _arm() -> mjcf.RootElement:
    # Without what gym-hil needs, which wants an older MuJoCo.
    model = load_package_mjcf("gym_hil", "assets/panda.xml", "panda", "pip install --no-deps 'gym-hil>=0.1.14'")
    # Its arm has motors in place of position servos.
    for number, link in enumerate(PUBLISHED.links, start=1):
        model.find("actuator", f"actuator{number}").remove()
        model.actuator.add("position", name=f"actuator{number}", joint=f"joint{number}", **link.actuator.servo)
    return model


PANDA = ArmSpec(
    name="panda",
    arm=_arm,
    servos=_SERVOS,
    hand_actuators=("fingers_actuator",),
    closed=255.0,
    open=0.0,
    tool="base",
    tool_pos=(0.0, 0.0, 0.12),
    tool_quat=(0.0, 0.0, 0.0, 1.0),
    # The hand is where the Franka's is.
    home=dict(zip(_SERVOS, (-0.0893, -0.9113, 1.9231, -2.4063, -0.75, 2.0054, -0.0025), strict=True)),
)

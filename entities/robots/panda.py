"""The Franka Emika Panda in its own joint convention.

Poses and limits: the manufacturer's (frankaemika.github.io/docs/control_parameters.html, limits for the Panda), hand
and fingers as in franka_description. Inertial parameters of the arm: C. Gaz, M. Cognetti, A. Oliva, P. Robuffo
Giordano, A. De Luca, "Dynamic Identification of the Franka Emika Panda Robot With Retrieval of Feasible Parameters
Using Penalty-Based Optimization", IEEE RA-L 4(4), 2019, as franka_ros publishes them
(franka_description/robots/common/inertial.yaml, Apache-2.0), the source for base, hand and fingers as well.
Gains and force limits of the actuators, armature and joint damping of the arm: MuJoCo Menagerie's Panda (Apache-2.0).
Fingers: chosen here. A bar of 12 mm held between the pads slips at a pull of about 20 N, four times the force that
opens a drawer.
"""

import math

from kitchen_suite.entities.assets import Vector
from kitchen_suite.entities.robots.specification import (
    Attributes,
    Finger,
    FrankaSpec,
    Inertia,
    JointActuator,
    Limits,
    Link,
)

# Half sizes of a finger pad: along the bar that it holds, in the direction of closing, along the finger [m].
PAD_HALF_SIZE = (0.0105, 0.005, 0.0095)

# Offsets along z [m]: from the hand to the fingers' frames, from the hand to the middle of the pads, from link 7 to the
# hand.
_FINGER_Z = 0.0584
_TOOL_Z = 0.1034
_HAND_Z = 0.107
_HAND_QUAT = (math.cos(math.pi / 8), 0.0, 0.0, -math.sin(math.pi / 8))

# Armature [kg m^2], damping [N m s/rad].
_JOINT = {"armature": 0.1, "damping": 1.0}
_SHOULDER = {**_JOINT, "gain": 4500.0, "velocity_gain": 450.0, "force": 87.0}
_ELBOW = {**_JOINT, "gain": 3500.0, "velocity_gain": 350.0, "force": 87.0}
_WRIST = {**_JOINT, "gain": 2000.0, "velocity_gain": 200.0, "force": 12.0}

_TURN, _TURN_BACK = {"quat": (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0)}, {"quat": (math.sqrt(0.5),) * 2 + (0.0, 0.0)}

# Origin [m], rotation, joint range [rad] and actuator parameters of links 1 to 7.
_KINEMATICS: tuple[tuple[Vector, Attributes, Limits, Attributes], ...] = (
    ((0, 0, 0.333), {}, (-2.8973, 2.8973), _SHOULDER),
    ((0, 0, 0), _TURN, (-1.7628, 1.7628), _SHOULDER),
    ((0, -0.316, 0), _TURN_BACK, (-2.8973, 2.8973), _ELBOW),
    ((0.0825, 0, 0), _TURN_BACK, (-3.0718, -0.0698), _ELBOW),
    ((-0.0825, 0.384, 0), _TURN, (-2.8973, 2.8973), _WRIST),
    ((0, 0, 0), _TURN_BACK, (-0.0175, 3.7525), _WRIST),
    ((0.088, 0, 0), _TURN_BACK, (-2.8973, 2.8973), _WRIST),
)


def _inertia(mass: float, centre: Vector, moments: tuple[float, ...]) -> Inertia:
    """Returns the inertia for a mass [kg], its centre [m], and the moments xx, yy, zz, xy, xz, yz about it [kg m^2]."""
    return Inertia(mass=mass, inertial={"pos": centre, "fullinertia": moments})


# Inertias of links 0 to 7.
_INERTIAS = (
    _inertia(
        0.629769,
        (-0.041018, -0.00014, 0.049974),
        (0.00315, 0.00388, 0.004285, 8.2904e-07, 0.00015, 8.2299e-06),
    ),
    _inertia(
        4.970684,
        (0.003875, 0.002081, -0.04762),
        (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169),
    ),
    _inertia(
        0.646926,
        (-0.003141, -0.02872, 0.003495),
        (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
    ),
    _inertia(
        3.228604,
        (0.027518, 0.039252, -0.066502),
        (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
    ),
    _inertia(
        3.587895,
        (-0.05317, 0.104419, 0.027454),
        (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
    ),
    _inertia(
        1.225946,
        (-0.011953, 0.041065, -0.038437),
        (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
    ),
    _inertia(
        1.666555,
        (0.060149, -0.014117, -0.010517),
        (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
    ),
    _inertia(
        0.735522,
        (0.010517, -0.004252, 0.061597),
        (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
    ),
)
_HAND_INERTIA = _inertia(0.73, (-0.01, 0.0, 0.03), (0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0))
_FINGER_INERTIA = _inertia(0.015, (0.0, 0.0, 0.0), (2.375e-06, 2.375e-06, 7.5e-07, 0.0, 0.0, 0.0))


def _links() -> tuple[Link, ...]:
    return tuple(
        Link(
            pos=pos,
            rotation=rotation,
            inertia=inertia,
            actuator=JointActuator(joint=f"joint{number}", range=joint_range, control_range=joint_range, **actuator),
        )
        for number, ((pos, rotation, joint_range, actuator), inertia) in enumerate(
            zip(_KINEMATICS, _INERTIAS[1:], strict=True), start=1
        )
    )


def _finger_geoms(side: str, sign: int) -> tuple[Attributes, ...]:
    """Returns the pad at the tip, and the shank between pad and hand."""
    pad = {
        "name": f"{side}_finger_pad",
        "type": "box",
        "size": PAD_HALF_SIZE,
        "pos": (0, sign * PAD_HALF_SIZE[1], _TOOL_Z - _FINGER_Z),
    }
    shank = {
        "name": f"{side}_finger_shank",
        "type": "box",
        "size": (0.0105, 0.0055, 0.0175),
        "pos": (0, sign * 0.0205, 0.0175),
    }
    return (pad, shank)


def _finger(side: str, number: int, sign: int) -> Finger:
    actuator = JointActuator(
        joint=f"finger_joint{number}",
        range=(0, 0.04),
        damping=5.0,
        armature=0.1,
        gain=1000.0,
        velocity_gain=100.0,
        force=100.0,
        control_range=(0, 0.04),
    )
    return Finger(
        side=side, axis=(0, sign, 0), inertia=_FINGER_INERTIA, actuator=actuator, geoms=_finger_geoms(side, sign)
    )


PANDA = FrankaSpec(
    base_inertia=_INERTIAS[0],
    links=_links(),
    hand_inertia=_HAND_INERTIA,
    hand_pos=(0.0, 0.0, _HAND_Z),
    hand_quat=_HAND_QUAT,
    fingers=(_finger("left", 1, 1), _finger("right", 2, -1)),
    finger_pos=(0, 0, _HAND_Z + _FINGER_Z),
    finger_scale=(1, 1, 1),
    # Torsional friction about the contact normal keeps a bar from turning between the pads.
    finger_contact={"condim": 4, "friction": (1.5, 0.005, 0.0001)},
    end_effector={"name": "gripper", "pos": (0, 0, _HAND_Z + _TOOL_Z), "quat": _HAND_QUAT},
    # Beside the hand, looking along the fingers, upright while the left finger is above the right one.
    wrist_camera={"pos": (0.08, -0.08, 0.11), "xyaxes": (-0.64, 0.64, -0.427, 1, 1, 0), "fovy": 75},
    # 0.11 m before the hand, looking at a point 0.08 m beyond the finger tips; upright as the camera above.
    hand_camera={"pos": (0.0778, -0.0778, 0.137), "xyaxes": (-0.57, 0.57, -0.59, 1, 1, 0), "fovy": 80},
)
"""The specification of the Franka Emika Panda, in its own joint convention."""

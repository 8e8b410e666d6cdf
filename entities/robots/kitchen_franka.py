"""The robot of FrankaKitchen-v1, gymnasium-robotics 1.4.2 (after vikashplus/franka).

The zero of joint 6 is a right angle from the Panda's own, hence its limits. Right angles are rounded to 1.57, as in
the original.
"""

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

# A finger collides with a box, and above it six pairs of crossed capsules that narrow towards the tip.
# Radius [m], y of the near and of the far end [m], z [m] of each pair.
_RUNGS = (
    (0.007, 0.006, 0.009, 0.0875),
    (0.0075, 0.007, 0.010, 0.0775),
    (0.0082, 0.008, 0.011, 0.0675),
    (0.009, 0.009, 0.012, 0.0575),
    (0.010, 0.0105, 0.0135, 0.0475),
    (0.011, 0.012, 0.015, 0.035),
)
_RUNG_HALF_WIDTH = 0.009


def _links() -> tuple[Link, ...]:
    turn, turn_back = {"quat": (0.707107, -0.707107, 0.0, 0.0)}, {"quat": (0.707107, 0.707107, 0.0, 0.0)}
    shoulder = {"damping": 100.0, "gain": 870.0, "force": 87.0}
    wrist = {"damping": 10.0, "gain": 120.0, "force": 12.0}
    # pos [m], rotation, mass [kg], joint range [rad], control range [rad], actuator parameters
    rows: tuple[tuple[Vector, Attributes, float, Limits, Limits, Attributes], ...] = (
        ((0, 0, 0.333), {}, 2.7063, (-2.8973, 2.8973), (-2.9671, 2.9671), shoulder),
        ((0, 0, 0), turn, 2.73046, (-1.7628, 1.7628), (-1.8326, 1.8326), shoulder),
        ((0, -0.316, 0), turn_back, 2.04104, (-2.8973, 2.8973), (-2.9671, 2.9671), shoulder),
        ((0.0825, 0, 0), turn_back, 2.08129, (-3.0718, -0.4), (-3.1416, 0), shoulder),
        ((-0.0825, 0.384, 0), turn, 3.00049, (-2.8973, 2.8973), (-2.9671, 2.9671), wrist),
        ((0, 0, 0), {"euler": (1.57, 0, 1.57)}, 1.3235, (-1.6573, 2.1127), (-3.7525, 2.1817), wrist),
        ((0.088, 0, 0), {"euler": (1.57, 0, 0.7854)}, 0.2, (-2.8973, 2.8973), (-2.9671, 2.9671), wrist),
    )
    return tuple(
        Link(
            pos=pos,
            rotation=rotation,
            inertia=Inertia(mass=mass),
            actuator=JointActuator(
                joint=f"panda0_joint{number}", range=joint_range, control_range=control_range, **actuator
            ),
        )
        for number, (pos, rotation, mass, joint_range, control_range, actuator) in enumerate(rows, start=1)
    )


def _finger_geoms(side: str, sign: int) -> tuple[Attributes, ...]:
    rungs = tuple(
        {
            "name": f"{side}_finger_rung_{number}{letter}",
            "type": "capsule",
            "size": (radius,),
            "fromto": (_RUNG_HALF_WIDTH, sign * start, z, -_RUNG_HALF_WIDTH, sign * end, z),
        }
        for number, (radius, near, far, z) in enumerate(_RUNGS)
        for letter, (start, end) in zip("ab", ((near, far), (far, near)), strict=True)
    )
    box = {
        "name": f"{side}_finger_box",
        "type": "box",
        "size": (0.0185, 0.012, 0.0175),
        "pos": (0, sign * 0.014, 0.015),
        "euler": (sign * 0.03, 0, 0),
    }
    return (*rungs, box)


def _finger(side: str, number: int, sign: int) -> Finger:
    inertial = {
        "pos": (sign * -1.57863e-05, sign * 0.0118731, 0.0434103),
        "quat": (0.705868, sign * 0.0310348, sign * -0.0314925, 0.706962),
        "diaginertia": (6.57134e-05, 6.09611e-05, 1.09932e-05),
    }
    actuator = JointActuator(
        joint=f"panda0_finger_joint{number}",
        range=(0, 0.04),
        damping=100,
        armature=5,
        gain=500,
        force=70,
        control_range=(0, 0.04),
    )
    return Finger(
        side=side,
        axis=(0, sign, 0),
        inertia=Inertia(mass=0.0927059, inertial=inertial),
        actuator=actuator,
        geoms=_finger_geoms(side, sign),
    )


KITCHEN_FRANKA = FrankaSpec(
    base_inertia=Inertia(mass=2.91242),
    links=_links(),
    hand_inertia=Inertia(mass=0.81909),
    hand_pos=(0.0, 0.0, 0.107),
    hand_quat=(0.92388, 0.0, 0.0, -0.382683),
    fingers=(_finger("left", 1, 1), _finger("right", 2, -1)),
    finger_pos=(0, 0, 0.1654),
    finger_scale=(1.75, 1, 1.75),
    finger_contact={
        "condim": 6,
        "margin": 0.001,
        "friction": (1, 0.5, 0.0001),
        "solref": (0.01, 1),
        "solimp": (0.8, 0.9, 0.001),
    },
    end_effector={"name": "end_effector", "pos": (0, 0, 0.21), "euler": (0, 0, -0.785398)},
    # Beside the hand, above the fingers' plane, looking along the fingers.
    wrist_camera={"pos": (0.06, -0.06, 0.09), "xyaxes": (1, 1, 0, 0.64, -0.64, 0.427), "fovy": 75},
    # 0.11 m before the hand, looking at a point 0.08 m beyond the finger tips, with the hand at the lower edge.
    hand_camera={"pos": (0.0778, -0.0778, 0.137), "xyaxes": (1, 1, 0, 0.57, -0.57, 0.59), "fovy": 80},
)
"""The specification of the Franka of FrankaKitchen-v1."""

"""Specifications of the Franka Panda: those of FrankaKitchen-v1 and of the published model; `Franka` builds either."""

import dataclasses
import functools
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.assets import Vector

Limits = tuple[float, float]

# Attributes of an MJCF element by name.
Attributes = Mapping[str, Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointActuator:
    """A joint and the position actuator that drives it.

    Attributes:
      joint: name of the joint, and of the actuator.
      range: joint limits [rad] or [m].
      damping: damping of the joint [N m s/rad] or [N s/m].
      armature: rotor inertia at the joint [kg m^2] or [kg].
      gain: stiffness of the actuator, `kp` of MuJoCo's position actuator [N m/rad] or [N/m].
      velocity_gain: damping by the actuator, `kv` of MuJoCo's position actuator [N m s/rad] or [N s/m].
      force: greatest torque or force [N m] or [N].
      control_range: limits of the target [rad] or [m].
    """

    joint: str
    range: Limits
    damping: float
    armature: float = 0.0
    gain: float
    velocity_gain: float = 0.0
    force: float
    control_range: Limits

    @property
    def servo(self) -> Attributes:
        """MJCF attributes of the actuator, but for names."""
        forces = (-self.force, self.force)
        return {"kp": self.gain, "kv": self.velocity_gain, "forcerange": forces, "ctrlrange": self.control_range}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inertia:
    """Mass of a part and its distribution.

    Attributes:
      mass: mass [kg].
      inertial: MJCF attributes of the part's `inertial` beside the mass: centre of mass `pos` [m] and the moments of
        inertia about it [kg m^2]; empty where MuJoCo computes them from the convex hull of the collision mesh.
    """

    mass: float
    inertial: Attributes = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Link:
    """A moving link of the arm.

    Attributes:
      pos: origin of the link in the frame of the previous link [m].
      rotation: orientation of the link in the frame of the previous link, as one MJCF attribute (`quat` or `euler`).
      inertia: mass and its distribution in the link's frame.
      actuator: the joint about the link's z axis, with its actuator.
    """

    pos: Vector
    rotation: Attributes
    inertia: Inertia
    actuator: JointActuator


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finger:
    """One of the two fingers; its frame is the hand's frame shifted along z.

    Attributes:
      side: `left` or `right`.
      axis: direction in which it opens.
      inertia: mass and its distribution; always with `inertial` attributes.
      actuator: the finger's joint with its actuator.
      geoms: MJCF attributes of its colliding geoms, names included.
    """

    side: str
    axis: Vector
    inertia: Inertia
    actuator: JointActuator
    geoms: tuple[Attributes, ...]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class FrankaSpec:
    """All parameters in which models of the Panda differ; equal only to itself, so that it can be a key.

    Attributes:
      base_inertia: inertia of link 0.
      links: links 1 to 7, from the base outwards.
      hand_inertia: inertia of the hand.
      hand_pos: origin of the hand in the frame of link 7 [m].
      hand_quat: orientation of the hand in the frame of link 7; its z axis is the direction of approach, its y axis
        points to the left finger.
      fingers: the left finger, which opens towards the hand's +y, then the right one.
      finger_pos: origin of the fingers' frames in the frame of link 7 [m].
      finger_scale: scale of the finger's visual mesh.
      finger_contact: MJCF attributes that all colliding geoms of the fingers share.
      end_effector: MJCF attributes of the site between the fingers, in the frame of link 7, name included.
      wrist_camera: MJCF attributes of the camera `wrist` beside the hand, in the frame of link 7; it shows much of the
        hand.
      hand_camera: MJCF attributes of the camera `hand` before the hand, in the frame of link 7; it looks at the finger
        tips.
      home: positions of the joints at the start of an episode in the kitchen [rad, m].
    """

    base_inertia: Inertia
    links: tuple[Link, ...]
    hand_inertia: Inertia
    hand_pos: Vector
    hand_quat: tuple[float, float, float, float]
    fingers: tuple[Finger, Finger]
    finger_pos: Vector
    finger_scale: Vector
    finger_contact: Attributes
    end_effector: Attributes
    wrist_camera: Attributes
    hand_camera: Attributes
    home: tuple[float, ...] = ()

    @property
    def joint_actuators(self) -> tuple[JointActuator, ...]:
        """The nine joints with their actuators: the arm's from the base outwards, then the two fingers'."""
        return (*(link.actuator for link in self.links), *(finger.actuator for finger in self.fingers))

    @functools.cached_property
    def joint_limits(self) -> NDArray[np.float64]:
        """Least and greatest position `(2, 9)` of each of these joints [rad, m]; read-only."""
        limits = np.array([actuator.range for actuator in self.joint_actuators]).T.copy()
        limits.flags.writeable = False
        return limits


def _links(
    prefix: str, rows: Iterable[tuple[Vector, Attributes, Inertia, Limits, Limits, Attributes]]
) -> tuple[Link, ...]:
    """Returns links 1 to 7, whose joints are named by `prefix` and number.

    Each row has origin [m], rotation, inertia, joint range [rad], control range [rad], actuator parameters.
    """
    return tuple(
        Link(
            pos=pos,
            rotation=rotation,
            inertia=inertia,
            actuator=JointActuator(joint=f"{prefix}{number}", range=limits, control_range=targets, **parameters),
        )
        for number, (pos, rotation, inertia, limits, targets, parameters) in enumerate(rows, start=1)
    )


def _finger(sign: int, inertia: Inertia, geoms: Iterable[Attributes], *, prefix: str, **parameters: float) -> Finger:
    """Returns the left finger, which opens along y (`sign` 1), or the right one (`sign` -1).

    The names of geoms lack the side, `prefix` is that of the joint's name, and parameters are of the actuator.
    """
    side, number = ("left", 1) if sign == 1 else ("right", 2)
    travel = (0, 0.04)
    return Finger(
        side=side,
        axis=(0, sign, 0),
        inertia=inertia,
        actuator=JointActuator(joint=f"{prefix}{number}", range=travel, control_range=travel, **parameters),
        geoms=tuple({**geom, "name": f"{side}_finger_{geom['name']}"} for geom in geoms),
    )


_SHOULDER_SERVO = {"damping": 100.0, "gain": 870.0, "force": 87.0}
_WRIST_SERVO = {"damping": 10.0, "gain": 120.0, "force": 12.0}
_ROLL = {"quat": (0.707107, -0.707107, 0.0, 0.0)}  # Rotation by -90 degrees about x.
_UNROLL = {"quat": (0.707107, 0.707107, 0.0, 0.0)}  # Rotation by 90 degrees about x.

_TURN_6 = {"euler": (1.57, 0, 1.57)}  # Rotation of link 6 [rad].
_TURN_7 = {"euler": (1.57, 0, 0.7854)}  # Rotation of link 7 [rad].

_KITCHEN_LINKS = _links(
    "panda0_joint",
    (
        ((0, 0, 0.333), {}, Inertia(mass=2.7063), (-2.8973, 2.8973), (-2.9671, 2.9671), _SHOULDER_SERVO),
        ((0, 0, 0), _ROLL, Inertia(mass=2.73046), (-1.7628, 1.7628), (-1.8326, 1.8326), _SHOULDER_SERVO),
        ((0, -0.316, 0), _UNROLL, Inertia(mass=2.04104), (-2.8973, 2.8973), (-2.9671, 2.9671), _SHOULDER_SERVO),
        ((0.0825, 0, 0), _UNROLL, Inertia(mass=2.08129), (-3.0718, -0.4), (-3.1416, 0), _SHOULDER_SERVO),
        ((-0.0825, 0.384, 0), _ROLL, Inertia(mass=3.00049), (-2.8973, 2.8973), (-2.9671, 2.9671), _WRIST_SERVO),
        ((0, 0, 0), _TURN_6, Inertia(mass=1.3235), (-1.6573, 2.1127), (-3.7525, 2.1817), _WRIST_SERVO),
        ((0.088, 0, 0), _TURN_7, Inertia(mass=0.2), (-2.8973, 2.8973), (-2.9671, 2.9671), _WRIST_SERVO),
    ),
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


def _kitchen_finger(sign: int) -> Finger:
    inertial = {
        "pos": (sign * -1.57863e-05, sign * 0.0118731, 0.0434103),
        "quat": (0.705868, sign * 0.0310348, sign * -0.0314925, 0.706962),
        "diaginertia": (6.57134e-05, 6.09611e-05, 1.09932e-05),
    }
    rungs = (
        {
            "name": f"rung_{number}{letter}",
            "type": "capsule",
            "size": (radius,),
            "fromto": (_RUNG_HALF_WIDTH, sign * start, z, -_RUNG_HALF_WIDTH, sign * end, z),
        }
        for number, (radius, near, far, z) in enumerate(_RUNGS)
        for letter, (start, end) in zip("ab", ((near, far), (far, near)), strict=True)
    )
    box = {
        "name": "box",
        "type": "box",
        "size": (0.0185, 0.012, 0.0175),
        "pos": (0, sign * 0.014, 0.015),
        "euler": (sign * 0.03, 0, 0),
    }
    inertia = Inertia(mass=0.0927059, inertial=inertial)
    servo = {"damping": 100, "armature": 5, "gain": 500, "force": 70}
    return _finger(sign, inertia, (*rungs, box), prefix="panda0_finger_joint", **servo)


KITCHEN_FRANKA = FrankaSpec(
    base_inertia=Inertia(mass=2.91242),
    links=_KITCHEN_LINKS,
    hand_inertia=Inertia(mass=0.81909),
    hand_pos=(0.0, 0.0, 0.107),
    hand_quat=(0.92388, 0.0, 0.0, -0.382683),
    fingers=(_kitchen_finger(1), _kitchen_finger(-1)),
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
    home=(
        *(0.148388023, -1.76848573, 1.84390296, -2.4768576, 0.260252026, 0.712533105, 1.59515394),
        *(0.0479267505, 0.0371350919),
    ),
)
"""The specification of the Franka of FrankaKitchen-v1."""


# Half sizes of a finger pad: along the bar that it holds, in the direction of closing, along the finger [m].
PAD_HALF_SIZE = (0.0105, 0.005, 0.0095)

_FINGER_Z = 0.0584  # Offset along z from the hand to the fingers' frames [m].
_TOOL_Z = 0.1034  # Offset along z from the hand to the middle of the pads [m].
_HAND_Z = 0.107  # Offset along z from link 7 to the hand [m].
_HAND_QUAT = (math.cos(math.pi / 8), 0.0, 0.0, -math.sin(math.pi / 8))

# Armature [kg m^2], damping [N m s/rad].
_JOINT = {"armature": 0.1, "damping": 1.0}
_SHOULDER = {**_JOINT, "gain": 4500.0, "velocity_gain": 450.0, "force": 87.0}
_ELBOW = {**_JOINT, "gain": 3500.0, "velocity_gain": 350.0, "force": 87.0}
_WRIST = {**_JOINT, "gain": 2000.0, "velocity_gain": 200.0, "force": 12.0}

_TURN = {"quat": (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0)}  # Rotation by -90 degrees about x.
_TURN_BACK = {"quat": (math.sqrt(0.5),) * 2 + (0.0, 0.0)}  # Rotation by 90 degrees about x.

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


# Mass, centre and moments of links 0 to 7; see `_inertia`.
_INERTIAS = tuple(
    _inertia(*row)
    for row in (
        (0.629769, (-0.041018, -0.00014, 0.049974), (0.00315, 0.00388, 0.004285, 8.2904e-07, 0.00015, 8.2299e-06)),
        (4.970684, (0.003875, 0.002081, -0.04762), (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169)),
        (0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704)),
        (3.228604, (0.027518, 0.039252, -0.066502), (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805)),
        (3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641)),
        (1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229)),
        (1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341)),
        (0.735522, (0.010517, -0.004252, 0.061597), (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741)),
    )
)
_HAND_INERTIA = _inertia(0.73, (-0.01, 0.0, 0.03), (0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0))
_FINGER_INERTIA = _inertia(0.015, (0.0, 0.0, 0.0), (2.375e-06, 2.375e-06, 7.5e-07, 0.0, 0.0, 0.0))


def _panda_finger(sign: int) -> Finger:
    """Returns a finger with a pad at its tip, and a shank between pad and hand."""
    pad_pos = (0, sign * PAD_HALF_SIZE[1], _TOOL_Z - _FINGER_Z)
    pad = {"name": "pad", "type": "box", "size": PAD_HALF_SIZE, "pos": pad_pos}
    shank = {"name": "shank", "type": "box", "size": (0.0105, 0.0055, 0.0175), "pos": (0, sign * 0.0205, 0.0175)}
    servo = {"damping": 5.0, "armature": 0.1, "gain": 1000.0, "velocity_gain": 100.0, "force": 100.0}
    return _finger(sign, _FINGER_INERTIA, (pad, shank), prefix="finger_joint", **servo)


PANDA = FrankaSpec(
    base_inertia=_INERTIAS[0],
    links=_links(
        "joint",
        (
            (pos, rotation, inertia, limits, limits, servo)
            for (pos, rotation, limits, servo), inertia in zip(_KINEMATICS, _INERTIAS[1:], strict=True)
        ),
    ),
    hand_inertia=_HAND_INERTIA,
    hand_pos=(0.0, 0.0, _HAND_Z),
    hand_quat=_HAND_QUAT,
    fingers=(_panda_finger(1), _panda_finger(-1)),
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

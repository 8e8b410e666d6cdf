"""What tells one model of the Franka Panda from another; `Franka` builds any of them the same way."""

import dataclasses
from collections.abc import Mapping
from typing import Any

Vector = tuple[float, float, float]
Limits = tuple[float, float]

# Attributes of an MJCF element by name.
Attributes = Mapping[str, Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointActuator:
    """A joint and the position servo that drives it.

    Attributes:
      joint: name of the joint, and of the actuator.
      range: joint limits [rad] or [m].
      damping: [N m s/rad] or [N s/m].
      armature: rotor inertia felt at the joint [kg m^2] or [kg].
      gain: servo stiffness, `kp` of MuJoCo's position actuator [N m/rad] or [N/m].
      velocity_gain: damping by the servo, `kv` there [N m s/rad] or [N s/m].
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inertia:
    """The mass of a part, and how it is spread.

    Attributes:
      mass: [kg].
      spread: MJCF attributes of the part's `inertial`: centre of mass `pos` [m] and the moments about it [kg m^2];
        empty where the mass is spread evenly over the convex hull of the part's collision mesh.
    """

    mass: float
    spread: Attributes = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Link:
    """A moving link of the arm.

    Attributes:
      pos: origin of the link in the frame of the link before it [m].
      rotation: the link's orientation there, as one MJCF attribute (`quat` or `euler`).
      inertia: its mass, in its own frame.
      servo: what moves it, about its z axis.
    """

    pos: Vector
    rotation: Attributes
    inertia: Inertia
    actuator: JointActuator


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finger:
    """One of the two fingers, in a frame that is the hand's moved along z.

    Attributes:
      side: `left` or `right`.
      axis: direction in which it opens.
      inertia: its mass; always with a `spread`.
      servo: what moves it.
      geoms: MJCF attributes of its colliding geoms, names included.
    """

    side: str
    axis: Vector
    inertia: Inertia
    actuator: JointActuator
    geoms: tuple[Attributes, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrankaSpec:
    """Everything that tells one model of the Panda from another.

    Attributes:
      base_inertia: mass of link 0.
      links: links 1 to 7, from the base outwards.
      hand_inertia: mass of the hand.
      hand_pos: origin of the hand in the frame of link 7 [m].
      hand_quat: the hand's orientation there; its z axis is the direction of approach, y the one of the fingers.
      fingers: the left finger, which opens towards the hand's +y, then the right one.
      finger_pos: where the fingers' frames sit in the frame of link 7 [m].
      finger_scale: scale of the mesh that shows a finger.
      finger_contact: MJCF attributes that all colliding geoms of the fingers share.
      end_effector: MJCF attributes of the site between the fingers, in the frame of link 7, name included.
      wrist_camera: MJCF attributes of the camera beside the hand, in the frame of link 7.
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

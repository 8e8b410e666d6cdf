"""Specification of a Franka Panda: the parameters in which its models differ; `Franka` builds any of them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

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

    @property
    def joint_actuators(self) -> tuple[JointActuator, ...]:
        """The nine joints with their actuators: the arm's from the base outwards, then the two fingers'."""
        return (*(link.actuator for link in self.links), *(finger.actuator for finger in self.fingers))

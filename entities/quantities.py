"""Kinds of parameters that displace the start of an episode, or scale what the built scene has.

`Randomizer.set` writes values to the start state and to the model as they were built, so a displacement is added once,
and a scale multiplies what was built.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.entities.parameters import Elements, Parameter, Quantity

# Number of positions of a free joint.
_FREE = 7


def displacement(
    name: str, joints: Sequence[mjcf.Element], *, unit: str, followers: Sequence[mjcf.Element] = (), ratio: float = 0.0
) -> Parameter:
    """Returns the displacement of slides or hinges from where an episode starts: a number, or one for each joint.

    Args:
      name: of the parameter.
      joints: that are displaced.
      unit: of the displacement.
      followers: joints that an equality constraint couples to these, one by one.
      ratio: displacement of a follower for one unit of its joint's.
    """
    count = len(joints)
    shape = () if count == 1 else (count,)

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        physics.bind(elements[:count]).qpos += value
        if followers:
            physics.bind(elements[count:]).qpos += ratio * value

    quantity = Quantity(read=lambda physics, elements: np.zeros(shape), write=write, model_fields=(), shape=shape)
    return Parameter(name=name, unit=unit, quantity=quantity, elements=(*joints, *followers))


def _displace_freely(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    (joint,) = elements
    x, y, yaw = value
    start = int(physics.bind(joint).qposadr)
    position, quaternion = np.split(physics.data.ptr.qpos[start : start + _FREE], [3])
    position[:2] += x, y
    if yaw:
        turn = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        mujoco.mju_mulQuat(quaternion, turn, quaternion.copy())


# Displacement of a free joint from where an episode starts: x and y [m], and rotation about the vertical [rad].
FREE_DISPLACEMENT = Quantity(
    read=lambda physics, elements: np.zeros(3), write=_displace_freely, model_fields=(), shape=(3,)
)


def _one(physics: mjcf.Physics, elements: Elements) -> ArrayLike:
    return 1.0


def _scale(attribute: str, model_field: str) -> Quantity:
    """Returns the factor of an attribute of elements, relative to the built scene."""

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        bound = physics.bind(elements)
        setattr(bound, attribute, getattr(bound, attribute) * value)

    return Quantity(read=_one, write=write, model_fields=(model_field,), non_negative=True)


def _scale_sliding_friction(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    physics.model.ptr.geom_friction[physics.bind(elements).element_id, 0] *= value


def _scale_gains(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    indices = physics.bind(elements).element_id
    model = physics.model.ptr
    # A position servo: gain * (target - position).
    model.actuator_gainprm[indices, 0] *= value
    model.actuator_biasprm[indices, 1] *= value


def _write_mass(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
    bound = physics.bind(elements[0])
    ratio = value / bound.mass
    bound.inertia *= ratio
    bound.mass = value


DAMPING_SCALE = _scale("damping", "dof_damping")
FRICTION_SCALE = _scale("frictionloss", "dof_frictionloss")

# Factor of the coefficients of sliding friction of geoms.
SLIDING_FRICTION_SCALE = Quantity(
    read=_one, write=_scale_sliding_friction, model_fields=("geom_friction",), non_negative=True
)

# Factor of the gains of position servos.
GAIN_SCALE = Quantity(
    read=_one, write=_scale_gains, model_fields=("actuator_gainprm", "actuator_biasprm"), non_negative=True
)

# Mass of a body [kg], with inertia in proportion.
MASS = Quantity(
    read=lambda physics, elements: physics.bind(elements[0]).mass,
    write=_write_mass,
    model_fields=("body_mass", "body_inertia"),
    non_negative=True,
    derived=True,
)


def scale(name: str, quantity: Quantity, elements: Sequence[mjcf.Element]) -> Parameter:
    """Returns a factor of what the built scene has, 1 by default."""
    return Parameter(name=name, unit="1", quantity=quantity, elements=tuple(elements))


def door_parameters(owner: str, joints: Sequence[mjcf.Element]) -> tuple[Parameter, ...]:
    """Returns factors of damping and of dry friction of an owner's doors, drawers or knobs."""
    return (
        scale(f"{owner}/damping_scale", DAMPING_SCALE, joints),
        scale(f"{owner}/friction_scale", FRICTION_SCALE, joints),
    )

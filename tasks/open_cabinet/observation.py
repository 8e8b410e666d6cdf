"""The open_cabinet domain's observation: 25 numbers in named parts, and their noise."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.control_modes.joints import JOINT_HIGH, JOINT_LOW
from kitchen_suite.tasks.open_cabinet.features import FEATURES_SIZE, Features
from kitchen_suite.tasks.terms import end_to_end
from kitchen_suite.types import Array

LIMIT = 5.0  # Observations are clipped to [-LIMIT, LIMIT].

_MIDDLE = (JOINT_HIGH + JOINT_LOW) / 2.0
_HALF_RANGE = (JOINT_HIGH - JOINT_LOW) / 2.0

_XYZW = np.array([1, 2, 3, 0])  # Indices of x, y, z, w, the order in observations, among w, x, y, z.


def scaled_joint_positions(features: Features) -> Array:
    """`(..., 8)`: arm and left finger, -1 at the joint's lower limit and 1 at its upper one."""
    return (features.joint_positions[..., :8] - _MIDDLE) / _HALF_RANGE


def scaled_joint_velocities(features: Features) -> Array:
    """`(..., 8)`: arm [2 rad/s] and left finger [2 m/s]."""
    return features.joint_velocities[..., :8] / 2.0


def handle_offset(features: Features) -> Array:
    """`(..., 3)`: from the gripper to the handle, along the world's axes [m]."""
    return features.handle_offset


def handle_orientation_offset(features: Features) -> Array:
    """`(..., 4)`: handle quaternion minus gripper quaternion, element by element in the order x, y, z, w.

    The handle's w is never negative, and the gripper's sign is the one nearer to the handle, so equal orientations
    give zero.
    """
    handle, nearer = features.handle_quaternion, _sign(features.quaternion_product[..., np.newaxis])
    offset = (handle - features.tcp_quaternion * nearer) * _sign(handle[..., :1])
    return offset.take(_XYZW, axis=-1)


def drawer_position(features: Features) -> Array:
    """`(..., 1)`: how far the drawer is open [m]."""
    return features.drawer_position[..., np.newaxis]


def drawer_velocity(features: Features) -> Array:
    """`(..., 1)`: how fast it opens [m/s]."""
    return features.drawer_velocity[..., np.newaxis]


def _sign(value: Array) -> Array:
    return np.copysign(1.0, value)


# Functions of the parts, before clipping, by observation key, in the order of the flat vector.
QUANTITIES: Mapping[str, Callable[[Features], Array]] = MappingProxyType(
    {
        "joint_positions": scaled_joint_positions,
        "joint_velocities": scaled_joint_velocities,
        "handle_offset": handle_offset,
        "handle_orientation_offset": handle_orientation_offset,
        "drawer_position": drawer_position,
        "drawer_velocity": drawer_velocity,
    }
)

# Keys of the robot's parts.
ROBOT_KEYS = ("joint_positions", "joint_velocities")

# Slice of each part in the flat vector.
SLICES = end_to_end({key: compute(Features(np.zeros(FEATURES_SIZE))).size for key, compute in QUANTITIES.items()})
SIZE = sum(place.stop - place.start for place in SLICES.values())


def clipped(values: Array) -> NDArray[np.float32]:
    """Returns values clipped to [-5, 5], in single precision."""
    return np.minimum(np.maximum(values, -LIMIT), LIMIT).astype(np.float32)


def observe(features: Features) -> Array:
    """Returns the flat vector `(..., 25)`, not yet clipped."""
    return np.concatenate([compute(features) for compute in QUANTITIES.values()], axis=-1)


def noise_scale(widths: Mapping[str, float] | None) -> Array:
    """Returns the greatest noise `(25,)` of each element, in its unit.

    Args:
      widths: half widths of the uniform noise by part, in the unit of the part; None for none.
    """
    if not isinstance(widths, Mapping | None):
        shown = checks.shown(widths)
        raise TypeError(f"observation_noise must map parts of the observation to widths, got {shown}")
    scale = np.zeros(SIZE)
    for name, width in (widths or {}).items():
        part = checks.choice(name, QUANTITIES.keys(), "part of the observation")
        scale[SLICES[part]] = checks.number(width, f"observation_noise of {name!r}")
    return scale

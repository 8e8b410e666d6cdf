"""The open_cabinet domain's observation: 25 numbers, as named parts whose concatenation is the flat vector."""

import collections
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.assets import Array
from kitchen_suite.tasks.control_modes.joints import JOINT_HIGH, JOINT_LOW
from kitchen_suite.tasks.open_cabinet.features import Features

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
PARTS: Mapping[str, Callable[[Features], Array]] = MappingProxyType(
    {
        "joint_positions": scaled_joint_positions,
        "joint_velocities": scaled_joint_velocities,
        "handle_offset": handle_offset,
        "handle_orientation_offset": handle_orientation_offset,
        "drawer_position": drawer_position,
        "drawer_velocity": drawer_velocity,
    }
)

# Slice of each part in the flat vector.
SLICES: Mapping[str, slice] = MappingProxyType(
    {
        "joint_positions": slice(0, 8),
        "joint_velocities": slice(8, 16),
        "handle_offset": slice(16, 19),
        "handle_orientation_offset": slice(19, 23),
        "drawer_position": slice(23, 24),
        "drawer_velocity": slice(24, 25),
    }
)
SIZE = 25


def clipped(values: Array) -> NDArray[np.float32]:
    """Returns values clipped to [-5, 5], in single precision."""
    return np.minimum(np.maximum(values, -LIMIT), LIMIT).astype(np.float32)


def observe(features: Features) -> Array:
    """Returns the flat vector `(..., 25)`, not yet clipped."""
    return np.concatenate([compute(features) for compute in PARTS.values()], axis=-1)


class OpenCabinetObservables:
    """One enabled observable for each part of the present observation, which the task sets with `update`.

    Attributes:
      by_name: the observables by observation key, in the order of the flat vector.
      noise_scale: `(25,)`, greatest noise of each element, in its unit.
    """

    def __init__(self, noise_widths: Mapping[str, float] | None) -> None:
        """Builds the observables; those with noise have a corruptor, which returns the noisy part.

        `noise_widths` are half widths of the uniform noise by part, in the unit of the part; `None` for none.
        """
        if not isinstance(noise_widths, Mapping | None):
            shown = checks.shown(noise_widths)
            raise TypeError(f"observation_noise must map parts of the observation to widths, got {shown}")
        self.noise_scale = np.zeros(SIZE)
        for name, width in (noise_widths or {}).items():
            part = checks.choice(name, PARTS.keys(), "part of the observation")
            self.noise_scale[SLICES[part]] = checks.number(width, f"observation_noise of {name!r}")
        self._is_noisy = bool(self.noise_scale.any())
        self._clean = self._noisy = np.zeros(SIZE, np.float32)
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict()
        for name, indices in SLICES.items():
            self.by_name[name] = observable.Generic(lambda physics, indices=indices: self._clean[indices])
            self.by_name[name].enabled = True
            if self.noise_scale[indices].any():
                self.by_name[name].corruptor = lambda clean, random_state, indices=indices: self._noisy[indices]

    def update(self, values: Array, noise: Array) -> None:
        """Sets the present observation: `values` `(25,)` without noise and not yet clipped, and its `noise` `(25,)`.

        Noise is added before clipping, so that noisy observations keep the range.
        """
        self._clean = clipped(values)
        self._noisy = clipped(values + noise) if self._is_noisy else self._clean

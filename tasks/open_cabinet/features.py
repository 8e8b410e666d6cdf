"""What there is to know about a gripper and a drawer at one moment; all that observation and reward are made of."""

import functools
from collections.abc import Mapping
from types import MappingProxyType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Distance up to which the drawer counts as opened by its handle [m].
_HOLD_DISTANCE = 0.03

# Where each part stands among the numbers of a features; a part with an index in place of a slice has no axis.
FEATURE_INDICES: Mapping[str, slice | int] = MappingProxyType(
    {
        "joint_positions": slice(0, 9),
        "joint_velocities": slice(9, 18),
        "tcp_position": slice(18, 21),
        "tcp_quaternion": slice(21, 25),
        "handle_position": slice(25, 28),
        "handle_quaternion": slice(28, 32),
        "left_pad_height": 32,
        "right_pad_height": 33,
        "drawer_position": 34,
        "drawer_velocity": 35,
    }
)


def scalars(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns `values (...)`; without any axis as a scalar, with which numpy computes several times as fast."""
    return values[()]


class Features:
    """Positions and velocities after a control step, in the world's frame; the parts are views of one array.

    Attributes:
      values: `(..., 36)`, all parts end to end.
    """

    def __init__(self, values: NDArray[np.float64]) -> None:
        """Gives names to the parts of `values`."""
        self.values = values

    @classmethod
    def of(cls, **parts: ArrayLike) -> Self:
        """Makes a snapshot of all its parts, by name."""
        arrays = [np.asarray(parts[name], np.float64) for name in FEATURE_INDICES]
        axes = [isinstance(place, slice) for place in FEATURE_INDICES.values()]
        columns = [array if axis else array[..., np.newaxis] for array, axis in zip(arrays, axes, strict=True)]
        return cls(np.concatenate(columns, axis=-1))

    @property
    def joint_positions(self) -> NDArray[np.float64]:
        """`(..., 9)`: the arm's seven joints [rad], left and right finger [m]."""
        return self.values[..., FEATURE_INDICES["joint_positions"]]

    @property
    def joint_velocities(self) -> NDArray[np.float64]:
        """`(..., 9)`: likewise [rad/s, m/s]."""
        return self.values[..., FEATURE_INDICES["joint_velocities"]]

    @property
    def tcp_position(self) -> NDArray[np.float64]:
        """`(..., 3)`: the point between the finger tips [m]."""
        return self.values[..., FEATURE_INDICES["tcp_position"]]

    @property
    def tcp_quaternion(self) -> NDArray[np.float64]:
        """`(..., 4)`: w, x, y, z; z is the direction of approach, y points to the left finger."""
        return self.values[..., FEATURE_INDICES["tcp_quaternion"]]

    @property
    def handle_position(self) -> NDArray[np.float64]:
        """`(..., 3)`: middle of the drawer's bar [m]."""
        return self.values[..., FEATURE_INDICES["handle_position"]]

    @property
    def handle_quaternion(self) -> NDArray[np.float64]:
        """`(..., 4)`: w, x, y, z; equal to the gripper's when it holds the bar from the front."""
        return self.values[..., FEATURE_INDICES["handle_quaternion"]]

    @property
    def left_pad_height(self) -> NDArray[np.float64]:
        """`(...)`: z of the left finger's pad [m]."""
        return scalars(self.values[..., FEATURE_INDICES["left_pad_height"]])

    @property
    def right_pad_height(self) -> NDArray[np.float64]:
        """`(...)`: z of the right finger's pad [m]."""
        return scalars(self.values[..., FEATURE_INDICES["right_pad_height"]])

    @property
    def drawer_position(self) -> NDArray[np.float64]:
        """`(...)`: 0 when closed, positive when open [m]."""
        return scalars(self.values[..., FEATURE_INDICES["drawer_position"]])

    @property
    def drawer_velocity(self) -> NDArray[np.float64]:
        """`(...)`: positive when opening [m/s]."""
        return scalars(self.values[..., FEATURE_INDICES["drawer_velocity"]])

    @functools.cached_property
    def handle_offset(self) -> NDArray[np.float64]:
        """`(..., 3)`: from the point between the finger tips to the handle, along the world's axes [m]."""
        return self.handle_position - self.tcp_position

    @functools.cached_property
    def handle_distance(self) -> NDArray[np.float64]:
        """`(...)`: how long that is [m]."""
        return np.sqrt(np.add.reduce(np.square(self.handle_offset), axis=-1))

    @functools.cached_property
    def quaternion_product(self) -> NDArray[np.float64]:
        """`(...)`: inner product of the two quaternions, plus or minus the cosine of half the angle between them."""
        return np.add.reduce(self.handle_quaternion * self.tcp_quaternion, axis=-1)

    @functools.cached_property
    def is_held_open(self) -> NDArray[np.bool_]:
        """`(...)`: whether the drawer is open at all, and the gripper within 0.03 m of its handle."""
        return (self.drawer_position > 0.0) & (self.handle_distance <= _HOLD_DISTANCE)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Copies of all parts by name; `Features.of(**arrays)` is the same features."""
        return {name: np.array(self.values[..., place]) for name, place in FEATURE_INDICES.items()}

"""Rotations as quaternions w, x, y, z and as rotation vectors [rad], on arrays with any leading axes `(...)`."""

import numpy as np
from numpy.typing import NDArray

# Below this angle [rad] a rotation vector is twice the vector part of its quaternion.
_SMALL = 1e-9

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the lengths `(..., 1)` of vectors `(..., k)`."""
    # In C order, a row has the same sum alone and among many.
    return np.sqrt(np.add.reduce(np.square(vectors, order="C"), axis=-1, keepdims=True))


def within(vectors: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    """Returns vectors `(..., k)`, shortened to the length `limit` where they are longer."""
    return vectors * (limit / np.maximum(length(vectors), limit))


def quaternion(rotation_vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the unit quaternions `(..., 4)` of rotation vectors `(..., 3)`."""
    angle = length(rotation_vector)
    # sin(a / 2) / a, 1/2 at a = 0.
    scale = np.where(angle > _SMALL, np.sin(angle / 2.0) / np.maximum(angle, _SMALL), 0.5)
    return np.concatenate([np.cos(angle / 2.0), rotation_vector * scale], axis=-1)


def rotation_vector(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the rotation vectors `(..., 3)`, of at most half a turn, of unit quaternions `(..., 4)`."""
    # q and -q are the same rotation; the one with w >= 0 turns by at most half a turn.
    nearer = quaternion * np.copysign(1.0, quaternion[..., :1])
    sine = length(nearer[..., 1:])
    angle = 2.0 * np.arctan2(sine, nearer[..., :1])
    return nearer[..., 1:] * np.where(sine > _SMALL, angle / np.maximum(sine, _SMALL), 2.0)


def product(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the rotations `(..., 4)` that turn by `second`, then by `first`."""
    # Element by element: the matrix products of dm_control's `quat_mul` round differently for one and for many.
    w, x, y, z = (first[..., i] for i in range(4))
    a, b, c, d = (second[..., i] for i in range(4))
    parts = (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )
    return np.stack(parts, axis=-1)


def difference(target: NDArray[np.float64], present: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the rotation vectors `(..., 3)`, about the world's axes, from one orientation to another."""
    return rotation_vector(product(target, inverse(present)))


def rotated(quaternion: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns vectors `(..., 3)` turned by unit quaternions `(..., 4)`."""
    axis = quaternion[..., 1:]
    turned = 2.0 * np.cross(axis, vectors)
    return vectors + quaternion[..., :1] * turned + np.cross(axis, turned)


def inverse(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the inverse rotations `(..., 4)` of unit quaternions."""
    return quaternion * _CONJUGATE


_CONJUGATE_2 = np.array([1.0, -1.0, -1.0, -1.0])

# Indices of the two axes that follow x, y and z in cyclic order.
_NEXT, _AFTER_NEXT = [1, 2, 0], [2, 0, 1]


def inverse_2(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the quaternions `(..., 4)` of the inverse rotations."""
    return quaternion * _CONJUGATE_2


def rotate(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns vectors `(..., 3)` rotated by quaternions `(..., 4)`."""
    scalar, axis = quaternion[..., :1], quaternion[..., 1:]
    turn = 2.0 * _cross(axis, vector)
    return vector + scalar * turn + _cross(axis, turn)


def _cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    # Several times as fast as numpy.cross.
    return one[..., _NEXT] * other[..., _AFTER_NEXT] - one[..., _AFTER_NEXT] * other[..., _NEXT]

"""Vectors, and rotations as quaternions w, x, y, z and as rotation vectors [rad], with any leading axes `(...)`."""

import numpy as np

from kitchen_suite.types import Array

# Below this angle [rad] a rotation vector is twice the vector part of its quaternion.
_SMALL = 1e-9

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])

_NEXT = [1, 2, 0]  # Indices of the axes that follow x, y and z in cyclic order.
_AFTER_NEXT = [2, 0, 1]  # Indices of the axes after those.


def squared_length(vectors: Array) -> Array:
    """Returns the squared lengths `(...)` of vectors `(..., k)`."""
    # In C order, a row has the same sum alone and among many.
    return np.add.reduce(np.square(vectors, order="C"), axis=-1)


def length(vectors: Array) -> Array:
    """Returns the lengths `(..., 1)` of vectors `(..., k)`."""
    return np.sqrt(squared_length(vectors))[..., np.newaxis]


def within(vectors: Array, limit: float) -> Array:
    """Returns vectors `(..., k)`, shortened to the length `limit` where they are longer."""
    return vectors * (limit / np.maximum(length(vectors), limit))


def quaternion(rotation_vector: Array) -> Array:
    """Returns the unit quaternions `(..., 4)` of rotation vectors `(..., 3)`."""
    angle = length(rotation_vector)
    # sin(a / 2) / a, 1/2 at a = 0.
    scale = np.where(angle > _SMALL, np.sin(angle / 2.0) / np.maximum(angle, _SMALL), 0.5)
    return np.concatenate([np.cos(angle / 2.0), rotation_vector * scale], axis=-1)


def rotation_vector(quaternion: Array) -> Array:
    """Returns the rotation vectors `(..., 3)`, with angles of at most pi, of unit quaternions `(..., 4)`."""
    # q and -q are the same rotation; the one with w >= 0 has an angle of at most pi.
    nearer = quaternion * np.copysign(1.0, quaternion[..., :1])
    sine = length(nearer[..., 1:])
    angle = 2.0 * np.arctan2(sine, nearer[..., :1])
    return nearer[..., 1:] * np.where(sine > _SMALL, angle / np.maximum(sine, _SMALL), 2.0)


def product(first: Array, second: Array) -> Array:
    """Returns the rotations `(..., 4)` by `second`, then by `first`."""
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


def difference(target: Array, present: Array) -> Array:
    """Returns the rotation vectors `(..., 3)`, about the world's axes, from one orientation to another."""
    return rotation_vector(product(target, inverse(present)))


def rotated(quaternion: Array, vectors: Array) -> Array:
    """Returns vectors `(..., 3)` rotated by unit quaternions `(..., 4)`."""
    scalar, axis = quaternion[..., :1], quaternion[..., 1:]
    normal = 2.0 * cross(axis, vectors)
    return vectors + scalar * normal + cross(axis, normal)


def inverse(quaternion: Array) -> Array:
    """Returns the inverse rotations `(..., 4)` of unit quaternions."""
    return quaternion * _CONJUGATE


def cross(one: Array, other: Array) -> Array:
    """Returns the cross products `(..., 3)` of vectors: the bits of `numpy.cross`, several times as fast."""
    return one[..., _NEXT] * other[..., _AFTER_NEXT] - one[..., _AFTER_NEXT] * other[..., _NEXT]

"""Rotations of vectors by unit quaternions w, x, y, z, on arrays of shape `(..., n)`."""

import numpy as np
from numpy.typing import NDArray

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])

# Indices of the two axes that follow x, y and z in cyclic order.
_NEXT, _AFTER_NEXT = [1, 2, 0], [2, 0, 1]


def inverse(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the quaternions `(..., 4)` of the inverse rotations."""
    return quaternion * _CONJUGATE


def rotate(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns vectors `(..., 3)` rotated by quaternions `(..., 4)`."""
    scalar, axis = quaternion[..., :1], quaternion[..., 1:]
    turn = 2.0 * _cross(axis, vector)
    return vector + scalar * turn + _cross(axis, turn)


def _cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    # Several times as fast as numpy.cross.
    return one[..., _NEXT] * other[..., _AFTER_NEXT] - one[..., _AFTER_NEXT] * other[..., _NEXT]

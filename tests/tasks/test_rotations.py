"""Rotations agree with SciPy's, for one and for many, and a row has the same bits alone and among many."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kitchen_suite.tasks import rotations

# Vectors of rotation [rad]: none, tiny, small, half a turn and nearly so.
VECTORS = np.concatenate(
    [
        np.zeros((1, 3)),
        1e-12 * np.eye(3),
        1e-5 * np.eye(3),
        (np.pi - 1e-6) * np.eye(3),
        np.random.default_rng(0).normal(size=(20, 3)),
    ]
)
OTHERS = np.roll(VECTORS, 7, axis=0)


def expected(vectors):
    return Rotation.from_rotvec(vectors)


def scipy_order(quaternions):
    """Returns quaternions x, y, z, w for w, x, y, z."""
    return quaternions[..., [1, 2, 3, 0]]


def assert_same_rotation(quaternions, rotation):
    np.testing.assert_allclose(
        Rotation.from_quat(scipy_order(quaternions)).as_matrix(), rotation.as_matrix(), atol=1e-12
    )


def test_quaternions_of_rotation_vectors_are_scipys():
    found = rotations.quaternion(VECTORS)
    np.testing.assert_allclose(scipy_order(found), expected(VECTORS).as_quat(), atol=1e-15)


def test_rotation_vectors_of_quaternions_are_scipys_for_either_sign():
    quaternions = rotations.quaternion(VECTORS)
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(rotations.rotation_vector(sign * quaternions), VECTORS, rtol=1e-9, atol=1e-15)


def test_a_vector_longer_than_half_a_turn_becomes_the_shorter_way_round():
    found = rotations.rotation_vector(rotations.quaternion(np.array([0.0, 0.0, 1.5 * np.pi])))
    np.testing.assert_allclose(found, [0.0, 0.0, -0.5 * np.pi], atol=1e-12)


def test_products_turn_by_the_second_then_by_the_first():
    found = rotations.product(rotations.quaternion(VECTORS), rotations.quaternion(OTHERS))
    assert_same_rotation(found, expected(VECTORS) * expected(OTHERS))


def test_an_inverse_undoes_a_rotation():
    quaternions = rotations.quaternion(VECTORS)
    found = rotations.product(rotations.inverse(quaternions), quaternions)
    np.testing.assert_allclose(found, np.broadcast_to([1.0, 0.0, 0.0, 0.0], found.shape), atol=1e-12)


def test_a_difference_leads_from_one_orientation_to_the_other():
    target, present = rotations.quaternion(VECTORS), rotations.quaternion(OTHERS)
    step = rotations.difference(target, present)
    assert_same_rotation(rotations.product(rotations.quaternion(step), present), expected(VECTORS))
    assert np.linalg.norm(step, axis=-1).max() <= np.pi + 1e-9


def test_rotated_vectors_are_scipys():
    found = rotations.rotated(rotations.quaternion(VECTORS), OTHERS)
    np.testing.assert_allclose(found, expected(VECTORS).apply(OTHERS), atol=1e-12)


def test_cross_products_have_the_bits_of_numpys():
    np.testing.assert_array_equal(rotations.cross(VECTORS, OTHERS), np.cross(VECTORS, OTHERS))


def test_lengths():
    vectors = np.array([[3.0, 4.0], [0.0, 0.0], [-5.0, 12.0]])
    np.testing.assert_array_equal(rotations.squared_length(vectors), [25.0, 0.0, 169.0])
    np.testing.assert_array_equal(rotations.length(vectors), [[5.0], [0.0], [13.0]])


def test_vectors_within_a_limit_stay_and_longer_ones_are_shortened():
    vectors = np.array([[3.0, 4.0], [0.3, 0.4], [0.0, 0.0], [0.0, -1.0]])
    found = rotations.within(vectors, 1.0)
    np.testing.assert_allclose(found, [[0.6, 0.8], [0.3, 0.4], [0.0, 0.0], [0.0, -1.0]], atol=1e-15)


@pytest.mark.parametrize(
    "function",
    [
        rotations.squared_length,
        rotations.length,
        rotations.quaternion,
        lambda vectors: rotations.rotation_vector(rotations.quaternion(vectors)),
        lambda vectors: rotations.product(rotations.quaternion(vectors), rotations.quaternion(vectors[..., ::-1])),
        lambda vectors: rotations.rotated(rotations.quaternion(vectors), vectors[..., ::-1]),
    ],
    ids=["squared_length", "length", "quaternion", "rotation_vector", "product", "rotated"],
)
def test_a_row_has_the_same_bits_alone_and_among_many(function):
    # Memory of many in either order, as the simulations of a batch have it.
    for many in (VECTORS, np.asfortranarray(VECTORS)):
        np.testing.assert_array_equal(function(many), [function(row) for row in VECTORS])

"""Paths between joint positions, in a plane with walls."""

import itertools

import numpy as np
import pytest

from kitchen_suite.policies.experts.path_planning import connect

LOW, HIGH = np.array([-3.0, -3.0]), np.array([3.0, 3.0])


def beside_wall(start, end, gap=1.0):
    """Whether a straight motion stays out of a wall at x = 0, which is open from y = `gap` on."""
    points = start + np.linspace(0.0, 1.0, 50)[:, np.newaxis] * (end - start)
    return not ((np.abs(points[:, 0]) < 0.1) & (points[:, 1] < gap)).any()


def test_a_straight_motion_needs_nothing_between():
    path = connect(np.array([-1.0, 0.0]), np.array([-2.0, 1.0]), beside_wall, (LOW, HIGH), np.random.default_rng(0))
    assert path == []


@pytest.mark.parametrize("seed", range(8))
def test_a_path_leads_around_a_wall_and_touches_nothing(seed):
    first, last = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
    path = connect(first, last, beside_wall, (LOW, HIGH), np.random.default_rng(seed))
    assert path
    knots = [first, *path, last]
    assert all(beside_wall(start, end) for start, end in itertools.pairwise(knots))
    assert all((knot >= LOW).all() and (knot <= HIGH).all() for knot in knots)


def test_the_same_seed_finds_the_same_path():
    ends = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
    one, other = (connect(*ends, beside_wall, (LOW, HIGH), np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_there_is_no_path_through_a_wall_without_a_gap():
    def closed(start, end):
        return beside_wall(start, end, gap=10.0)

    ends = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
    assert connect(*ends, closed, (LOW, HIGH), np.random.default_rng(0)) is None

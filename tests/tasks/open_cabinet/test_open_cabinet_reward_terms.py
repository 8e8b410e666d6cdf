"""The formulas of the open_cabinet rewards by numbers computed by hand, for one row of features and for many."""

import numpy as np
import pytest
from helpers.open_cabinet import TERMS, step_of

from kitchen_suite.entities import CabinetConfig
from kitchen_suite.tasks.open_cabinet import rewards as reward
from kitchen_suite.tasks.open_cabinet.features import FEATURE_INDICES, FEATURES_SIZE, Features

RADIUS = 0.006
# Turns by 120 and 90 degrees.
THIRD_ABOUT_X = 0.5, np.sqrt(0.75), 0.0, 0.0
QUARTER_ABOUT_X = np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0
QUARTER_ABOUT_Z = np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)


def features(shape, **parts):
    """Returns features that are zero, with orientations of no turn, apart from the given parts."""
    values = np.zeros((*shape, FEATURES_SIZE))
    for name in ("tcp_quaternion", "handle_quaternion"):
        values[..., FEATURE_INDICES[name].start] = 1.0
    for name, part in parts.items():
        values[..., FEATURE_INDICES[name]] = part
    return Features(values)


def along(axis, *distances):
    """Returns points on an axis."""
    points = np.zeros((len(distances), 3))
    points[:, axis] = distances
    return points


def check(formula, expected, **parts):
    """Asserts the values of a formula for rows of features, all at once and each alone."""
    expected = np.array(expected)
    batch = features((len(expected),), **parts)
    together = formula(batch)
    assert together.shape == expected.shape
    np.testing.assert_allclose(together, expected, rtol=1e-12, atol=1e-15)
    for row, value in zip(batch.values, expected, strict=True):
        alone = formula(Features(row))
        assert np.shape(alone) == ()
        np.testing.assert_allclose(alone, value, rtol=1e-12, atol=1e-15)


def test_approach_falls_with_the_distance():
    check(reward.approach, [10.0, 10.0 * (1.0 - np.tanh(1.0))], handle_position=[[0.0] * 3, [0.06, 0.0, -0.08]])


def test_orientation_is_full_only_at_the_handle_of_an_open_drawer():
    parts = {
        "tcp_quaternion": THIRD_ABOUT_X,
        "handle_position": along(2, 0.02, 0.02, 0.04),
        "drawer_position": [0.0, 0.1, 0.1],
    }
    check(reward.orientation, [-0.5, 1.0, -0.5], **parts)
    check(reward.grasp_orientation, [-2.0, -2.0, -2.0], **parts)


def test_closing_pays_within_25_millimetres_of_the_handle():
    near = {"handle_position": along(1, 0.0, 0.02, 0.025, 0.1)}
    for gripper in (0.04, 0.01, 0.0):
        check(
            lambda rows, gripper=gripper: reward.grasp(rows, gripper),
            np.array([100.0, 100.0, -20.0, -20.0]) * (0.04 - gripper),
            **near,
        )


def test_opening_pays_at_the_handle():
    check(
        reward.opening,
        [0.0, 0.0, 20.0 * (np.exp(0.5) - 1.0), 20.0 * (np.e - 1.0), 0.0],
        drawer_position=[-0.2, 0.0, 0.5, 1.5, 0.5],
        handle_position=along(0, 0.0, 0.0, 0.03, 0.01, 0.031),
    )


def test_straddling_costs_for_each_pad_on_the_wrong_side_of_the_bar():
    check(
        reward.straddling,
        [0.0, -0.1, -0.2, -0.3],
        handle_position=along(2, *[0.5] * 4),
        left_pad_height=[0.6, 0.4, 0.6, 0.4],
        right_pad_height=[0.4, 0.4, 0.7, 0.7],
    )


@pytest.mark.parametrize(
    ("steps", "expected"), [(0, (1e-3, 0.0)), (7_999, (1e-3, 0.0)), (8_000, (2e-3, 2e-7)), (8_001, (2e-3, 2e-7))]
)
def test_penalties_have_their_weights_before_and_after_step_8000(steps, expected):
    np.testing.assert_allclose(reward.penalty_coefficients(steps), expected, rtol=1e-12)
    together = np.array(reward.penalty_coefficients(np.array([steps, 0])))
    np.testing.assert_allclose(together, np.transpose([expected, (1e-3, 0.0)]), rtol=1e-12)


def test_effort_costs_for_the_change_of_the_action_and_for_eight_joint_speeds():
    change = np.array([3.0, -1.0, *[0.0] * 5, 2.0])
    speeds = {"joint_velocities": [[2.0, 0.0, -1.0, *[0.0] * 4, 3.0, 100.0], [0.0] * 9]}
    check(lambda rows: reward.effort(rows, change, 0), [-14e-3] * 2, **speeds)
    check(lambda rows: reward.effort(rows, change, 9_000), [-28e-3 - 28e-7, -28e-3], **speeds)


def test_any_finite_change_of_the_action_has_a_finite_cost():
    change = np.array([1e300, -np.inf])
    with np.errstate(all="raise"):
        np.testing.assert_allclose(reward.effort(features(()), change, 0), -1e-3 * 2e300, rtol=1e-12)


def test_termination_costs_ten_and_is_otherwise_no_negative_zero():
    for terminated, expected in ((True, -10.0), (False, 0.0)):
        assert reward.termination(np.bool_(terminated)) == expected
    together = reward.termination(np.array([True, False]))
    assert together.tolist() == [-10.0, 0.0]
    assert not np.signbit(together[1])


def test_reaching_behind_the_handle_terminates():
    check(reward.terminates, [False, False, True, False], handle_position=along(0, -1.0, 0.03, 0.031, 0.0))
    check(reward.terminates, [False, False], handle_position=along(1, 0.5, -0.5))


@pytest.mark.parametrize("joint", range(9))
def test_each_joint_that_moves_too_fast_terminates(joint):
    velocities = np.zeros((5, 9))
    velocities[:, joint] = 5.0, -5.0, 5.1, -5.1, 0.0
    check(reward.terminates, [False, False, True, True, False], joint_velocities=velocities)
    # So does a hand that also reaches behind the handle.
    check(reward.terminates, [True] * 5, joint_velocities=velocities, handle_position=along(0, *[0.1] * 5))


def test_success_is_an_opening_of_at_least_30_centimetres():
    assert reward.SUCCESS_OPENING == 0.3
    assert [bool(reward.succeeds(position)) for position in (0.0, 0.299, 0.3, 1.0)] == [False, False, True, True]


def test_the_bar_is_seen_from_the_gripper():
    seen = features(
        (2,),
        tcp_position=[1.0, 2.0, 3.0],
        tcp_quaternion=QUARTER_ABOUT_X,
        # The bar lies along y of the world.
        handle_quaternion=QUARTER_ABOUT_Z,
        handle_position=[[1.01, 2.02, 3.03], [1.0, 1.98, 3.0]],
    )
    distance, nearest = reward.bar_in_gripper_frame(seen)
    np.testing.assert_allclose(distance, [0.02, -0.02], atol=1e-12)
    np.testing.assert_allclose(nearest, [[0.01, 0.03, 0.0], [0.0, 0.0, 0.0]], atol=1e-12)
    distance, nearest = reward.bar_in_gripper_frame(Features(seen.values[0]))
    np.testing.assert_allclose(distance, 0.02, atol=1e-12)
    np.testing.assert_allclose(nearest, [0.01, 0.03, 0.0], atol=1e-12)


def enclosure(rows):
    return reward.grip(rows, RADIUS).enclosure


def gap(rows):
    return reward.grip(rows, RADIUS).gap


def test_the_gap_is_that_of_the_farther_finger():
    positions = np.zeros((4, 9))
    positions[:, 7:] = [0.010, 0.020], [0.020, 0.010], [0.006, 0.006], [0.005, 0.007]
    # The bar is nearer to the left finger by 2 mm on either side of the middle.
    parts = {"joint_positions": positions, "handle_position": along(1, 0.002, 0.002, 0.0, 0.0)}
    check(gap, [0.016, 0.012, 0.0, 0.001], **parts)
    check(enclosure, [1.0, 1.0, 1.0, 1.0], **parts)


def test_pads_that_overlap_the_bar_by_more_than_half_its_radius_do_not_enclose_it():
    positions = np.zeros((5, 9))
    positions[:, 7:] = [0.003, 0.005], [0.005, 0.003], [0.0015, 0.005], [0.005, 0.0015], [0.005, 0.0]
    check(enclosure, [1.0, 1.0, 0.5, 0.5, 0.0], joint_positions=positions)
    check(gap, [0.0] * 5, joint_positions=positions)
    # A bar beside the left finger.
    check(enclosure, [0.0], joint_positions=positions[:1], handle_position=along(1, 0.02))


@pytest.mark.parametrize(
    ("turn", "axis", "half_width"),
    [((1.0, 0.0, 0.0, 0.0), 0, 0.03), (QUARTER_ABOUT_Z, 0, 0.0105), (QUARTER_ABOUT_Z, 1, 0.03), (None, 2, 0.0095)],
)
def test_the_enclosure_falls_to_zero_over_the_last_third_of_the_way_from_the_middle(turn, axis, half_width):
    positions = np.array([*[0.0] * 7, 0.006, 0.006])
    shares = np.array([0.0, 0.6, 0.7, 0.8, 0.9, 1.1, 2.0])
    for side in (-half_width, half_width):
        check(
            enclosure,
            [1.0, 1.0, 0.9, 0.6, 0.3, 0.0, 0.0],
            joint_positions=positions,
            handle_position=along(axis, *side * shares),
            **({"handle_quaternion": turn} if turn else {}),
        )


def test_the_enclosure_is_the_product_of_its_shares():
    check(
        enclosure,
        [0.9 * 0.6 * 0.3],
        joint_positions=[*[0.0] * 7, 0.006, 0.006],
        handle_quaternion=QUARTER_ABOUT_Z,
        handle_position=[[0.7 * 0.0105, -0.8 * 0.03, 0.9 * 0.0095]],
    )


def held(enclosure, gap):
    return reward.Grip(np.array(enclosure), np.array(gap))


def test_holding_is_halved_by_a_gap_of_one_millimetre():
    held_shares = held([1.0, 1.0, 0.5, 0.8, 0.75], [0.0, 0.001, 0.0, 0.003, 0.0005]).holding
    np.testing.assert_allclose(held_shares, [1.0, 0.5, 0.5, 0.2, 0.5])


def test_closing_pays_around_the_bar_and_costs_elsewhere():
    closing = reward.grip_closing(held([1.0, 1.0, 0.0, 0.5], [0.0, 0.03, 0.1, 0.03]), np.array([0.0, 0.04, 0.01, 0.01]))
    loose = 1.0 - np.tanh(1.5)
    np.testing.assert_allclose(closing, [4.0, 4.0 * loose, -0.6, 2.0 * loose - 0.3], rtol=1e-12)


def test_opening_pays_as_far_as_the_bar_is_held_and_closing_costs_in_full():
    pull = held([1.0, 0.5, 0.5, 0.0, 0.5, 0.5], [0.0] * 6)
    rows = features(
        (6,), drawer_position=[0.2, 0.2, 0.2, 0.2, 1.5, -0.1], drawer_velocity=[0.3, 0.3, -0.3, 0.3, 0.0, 0.0]
    )
    np.testing.assert_allclose(reward.grasp_opening(rows, pull), [13.0, 6.5, 2.0, 0.0, 25.0, 0.0], rtol=1e-12)


def step(rows, *, change, steps, gripper=0.01, terminates=False):
    """Returns the terms of each reward for a step from an action `change` away from the last one."""
    made = step_of(
        rows, gripper=gripper, action_change=1.0 + change, total_steps=steps, terminated=np.bool_(terminates)
    )
    made.before.previous_action = np.ones(8)
    return {
        name: {term: float(formula(made)) for term, formula in terms.items()} for name, terms in reward.REWARDS.items()
    }


CONFIG = CabinetConfig(handle_radius=0.008)


def test_the_terms_of_both_rewards_are_their_formulas():
    rows = features(
        (),
        joint_positions=[*[0.0] * 7, 0.009, 0.009],
        joint_velocities=[1.0] * 9,
        tcp_quaternion=THIRD_ABOUT_X,
        handle_quaternion=THIRD_ABOUT_X,
        handle_position=[0.0, 0.0, 0.02],
        left_pad_height=0.01,
        right_pad_height=0.0,
        drawer_position=0.2,
        drawer_velocity=0.1,
    )
    terms = step(rows, change=np.full(8, -0.25), steps=8_000, terminates=True)
    assert list(terms) == ["original", "grasp"]
    assert [tuple(each) for each in terms.values()] == [tuple(TERMS)] * 2
    shared = {
        "approach": 10.0 * (1.0 - np.tanh(0.2)),
        "straddling": -0.01,
        "effort": -2e-3 * 0.5 - 2e-7 * 8.0,
        "termination": -10.0,
    }
    grip = reward.grip(rows, CONFIG.handle_radius)
    original = {"orientation": 1.0, "grasp": 3.0, "opening": 20.0 * np.expm1(0.2)}
    grasp = {
        "orientation": 4.0,
        "grasp": float(reward.grip_closing(grip, 0.01)),
        "opening": float(reward.grasp_opening(rows, grip)),
    }
    assert terms["original"] == pytest.approx({**shared, **original}, rel=1e-12)
    assert terms["grasp"] == pytest.approx({**shared, **grasp}, rel=1e-12)


def test_actions_at_opposite_ends_of_the_float_range_cost_without_a_warning():
    made = step_of(features(()), gripper=0.0, action_change=np.full(8, 1.7e308), total_steps=0, terminated=False)
    made.before.previous_action = np.full(8, -1.7e308)
    with np.errstate(over="raise"):
        assert np.isfinite(reward.REWARDS["original"]["effort"](made))

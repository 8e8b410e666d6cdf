"""The kitchen's rewards by numbers computed by hand, for one episode and for many, without an environment."""

import types

import numpy as np
import pytest

from kitchen_suite.tasks import rewards as reward
from kitchen_suite.tasks.goals import Goal, GoalSet, ThresholdSuccess
from kitchen_suite.tasks.kitchen.shaping import Shaping, task_shares
from kitchen_suite.tasks.rewards import Shares, covered

# A door with one joint, which opens to 1, and a lid with two.
GOALS = GoalSet.build(
    {"door": Goal(prop="door", value=(1.0,)), "lid": Goal(prop="lid", value=(0.0, 0.5))}, ["door", "lid"]
)
DESIRED = np.array([1.0, 0.0, 0.5])
SUCCESS = ThresholdSuccess(GOALS, 0.2)

# Two episodes at their starts: the door is 1 and 0.5 from its goal, the lid 0.5 and 0.05.
START = np.array([[0.0, 0.3, 0.9], [0.5, 0.03, 0.54]])
HAND = np.array([[2.0, 0.8], [1.0, 0.05]])


def alone(state, episode):
    """Returns a state of one episode among many."""
    return type(state)(*(part[episode] for part in state))


def check(state, **expected):
    """Asserts fields of a state."""
    for name, value in expected.items():
        found = getattr(state, name)
        assert found.shape == np.shape(value), name
        np.testing.assert_allclose(found, value, rtol=1e-12, atol=1e-15, err_msg=name)


def check_equal(one, other):
    """Asserts that two states are equal."""
    for name, left, right in zip(one._fields, one, other, strict=True):
        np.testing.assert_array_equal(left, right, err_msg=name)
        assert np.shape(left) == np.shape(right), name


def test_the_share_covered_is_relative_to_the_start_and_at_least_to_ten_centimetres():
    initial = np.array([2.0, 2.0, 2.0, 2.0, 0.1, 0.05, 0.0, 0.0])
    distances = np.array([2.0, 0.5, 3.0, 0.0, 0.025, 0.05, 0.0, 0.2])
    expected = [0.0, 0.75, 0.0, 1.0, 0.75, 0.5, 1.0, 0.0]
    np.testing.assert_allclose(covered(distances, initial), expected, rtol=1e-12, atol=1e-15)
    assert [float(covered(*each)) for each in zip(distances, initial, strict=True)] == covered(
        distances, initial
    ).tolist()


def test_nothing_of_an_infinite_distance_has_been_covered():
    with np.errstate(all="raise"):
        assert covered(np.array([np.inf, np.inf]), np.array([np.inf, 1.0])).tolist() == [0.0, 0.0]


def test_a_reset_starts_at_its_own_distances():
    state = Shaping.start(START, HAND, GOALS)
    check(
        state,
        initial_achieved=START,
        initial_hand_distances=HAND,
        hand_distances=HAND,
        previous_achieved=START,
        # What starts nearer than 0.1 has come far.
        best_approach=[[0.0, 0.0], [0.0, 0.5]],
        best_progress=[[0.0, 0.0], [0.0, 0.5]],
        approach=[[0.0, 0.0], [0.0, 0.5]],
        previously_completed=np.zeros((2, 2), bool),
    )
    assert state.previously_completed.dtype == bool
    for episode in range(2):
        check_equal(Shaping.start(START[episode], HAND[episode], GOALS), alone(state, episode))


# The states before two steps: the door opens, then falls shut a little while the hand leaves it.
BEFORE = np.array([[0.0, 0.3, 0.9], [0.5, 0.03, 0.54]]), np.array([[0.6, 0.3, 0.9], [0.75, 0.0, 0.5]])
HANDS = np.array([[0.5, 0.8], [0.5, 0.0]]), np.array([[1.5, 0.4], [0.0, 0.3]])
COMPLETED = np.zeros((2, 2), bool), np.array([[False, False], [False, True]])


def after_steps(steps, episode=slice(None)):
    """Returns the state after some of these steps."""
    state = Shaping.start(START[episode], HAND[episode], GOALS)
    for achieved, completed, hand in [*zip(BEFORE, COMPLETED, HANDS, strict=True)][:steps]:
        state = state.after(achieved[episode], completed[episode], hand[episode], GOALS)
    return state


def test_a_step_keeps_the_best_shares_before_it():
    check(
        after_steps(1),
        initial_achieved=START,
        initial_hand_distances=HAND,
        hand_distances=HANDS[0],
        previous_achieved=START,
        best_approach=[[0.0, 0.0], [0.0, 0.5]],
        best_progress=[[0.0, 0.0], [0.0, 0.5]],
        approach=[[0.75, 0.0], [0.5, 1.0]],
        previously_completed=np.zeros((2, 2), bool),
    )
    check(
        after_steps(2),
        initial_achieved=START,
        initial_hand_distances=HAND,
        hand_distances=HANDS[1],
        previous_achieved=BEFORE[1],
        best_approach=[[0.75, 0.0], [0.5, 1.0]],
        best_progress=[[0.6, 0.0], [0.5, 1.0]],
        # The hand has left the door of the first episode, and the lid of the second.
        approach=[[0.75, 0.5], [1.0, 1.0]],
        previously_completed=COMPLETED[1],
    )
    for episode in range(2):
        check_equal(after_steps(2, episode), alone(after_steps(2), episode))


def test_progress_that_is_lost_remains_the_best():
    state = after_steps(2)
    shut = state.after(START, COMPLETED[1], HAND, GOALS)
    np.testing.assert_array_equal(shut.best_progress, state.best_progress)


def test_a_restart_in_one_episode_leaves_the_other():
    state, achieved = after_steps(2), np.array([[0.2, 0.0, 0.1], [0.9, 0.0, 0.5]])
    restarted = state.restarted(np.array([True, False]), achieved, GOALS)
    assert type(restarted) is Shaping
    check_equal(alone(restarted, 0), Shaping.start(achieved[0], HANDS[1][0], GOALS))
    check_equal(alone(restarted, 1), alone(state, 1))
    check_equal(after_steps(2, 0).restarted(np.array(True), achieved[0], GOALS), alone(restarted, 0))


# After the second step: the door of the first episode is at 0.5, and all else is at its goal.
ACHIEVED = np.array([[0.5, 0.0, 0.5], [1.0, 0.0, 0.5]])

EVERY_TASK = np.array([True, True])


def shares_of(desired, mask=EVERY_TASK):
    return task_shares(shaping=after_steps(2), success=SUCCESS, achieved=ACHIEVED, desired=desired, mask=mask)


def test_the_shares_of_the_episodes_own_goals():
    shares = shares_of(np.tile(DESIRED, (2, 1)))
    check(
        shares,
        approach=[[0.75, 0.5], [1.0, 1.0]],
        previous_approach=[[0.75, 0.0], [0.5, 1.0]],
        progress=[[0.5, 1.0], [1.0, 1.0]],
        previous_progress=[[0.6, 0.0], [0.5, 1.0]],
        is_relabelled=np.zeros((2, 2), bool),
        completed=np.array([[False, True], [True, True]]),
        previously_completed=COMPLETED[1],
        remains=[[1.0, 0.0], [0.0, 0.0]],
    )
    for one, other in zip(shares_of(DESIRED), shares, strict=True):
        np.testing.assert_array_equal(np.broadcast_to(one, (2, 2)), other)
    for episode in range(2):
        one = task_shares(
            after_steps(2, episode), success=SUCCESS, achieved=ACHIEVED[episode], desired=DESIRED, mask=EVERY_TASK
        )
        check_equal(one, alone(shares, episode))


def test_a_completed_task_stays_completed_when_it_leaves_its_goal():
    shares = task_shares(after_steps(2), success=SUCCESS, achieved=START, desired=DESIRED, mask=EVERY_TASK)
    assert shares.completed.tolist() == [[False, False], [False, True]]


def test_of_another_goal_only_the_step_before_is_known():
    # Another goal of the door in both episodes, and of one joint of the lid in the second.
    desired = np.array([[0.5, 0.0, 0.5], [1.5, 0.0, 0.25]])
    shares = shares_of(desired)
    check(
        shares,
        approach=[[0.75, 0.5], [1.0, 1.0]],
        previous_approach=[[0.75, 0.0], [0.5, 1.0]],
        # The lid started sqrt(0.03^2 + 0.29^2) from its other goal, and was 0.25 from it before the step and after it.
        progress=[[1.0, 1.0], [0.5, 1.0 - 0.25 / np.sqrt(0.085)]],
        previous_progress=[[0.8, 0.0], [0.25, 1.0 - 0.25 / np.sqrt(0.085)]],
        is_relabelled=np.array([[True, False], [True, True]]),
        # The first door was within 0.2 of its other goal before the step; the second is not, nor is the lid.
        completed=np.array([[True, True], [False, False]]),
        previously_completed=np.array([[True, False], [False, False]]),
    )


@pytest.mark.parametrize("mask", [[[True, False], [False, True]], [True, False]])
def test_tasks_outside_the_mask_have_not_come_anywhere(mask):
    shares, masked = shares_of(DESIRED), shares_of(DESIRED, mask=np.array(mask))
    for whole, part in zip(shares, masked, strict=True):
        assert part.dtype == whole.dtype
        np.testing.assert_array_equal(part, whole * np.array(mask))


def test_goals_that_are_infinitely_far_pay_nothing():
    far = np.array([1e200, 0.0, 0.5])
    with np.errstate(all="raise"):
        shares = shares_of(far)
    assert shares.progress[:, 0].tolist() == [0.0, 0.0]
    assert shares.completed[:, 0].tolist() == [False, False]


# Four tasks of three episodes.
SHARES = Shares(
    approach=np.array([[0.4, 0.8, 1.0, 0.2], [0.0] * 4, [1.0] * 4]),
    previous_approach=np.array([[0.2, 0.8, 0.4, 0.0], [0.0] * 4, [0.6] * 4]),
    progress=np.array([[0.5, 0.2, 0.9, 0.0], [0.4, 0.2, 0.0, 0.0], [1.0] * 4]),
    previous_progress=np.array([[0.1, 0.6, 0.4, 0.0], [0.8, 0.6, 0.0, 0.0], [0.6] * 4]),
    is_relabelled=np.array([[False] * 4, [True, False, False, False], [False] * 4]),
    completed=np.array([[False, False, True, False], [False] * 4, [True] * 4]),
    previously_completed=np.array([[False] * 4, [False] * 4, [True] * 4]),
)
COMPLETIONS = np.array([[False, True, True, True], [False] * 4, [False, False, True, False]])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("sparse", {"completion": [3.0, 0.0, 1.0]}),
        (
            "dense",
            {
                "approach": [0.25 * (0.4 + 0.8 + 0.2), 0.0, 0.0],
                "progress": [0.75 * (0.5 + 0.2), 0.75 * 0.6, 0.0],
                "completion": [1.0, 0.0, 4.0],
            },
        ),
        (
            "dense_gain",
            {
                "approach": [0.25 * (0.2 + 0.2), 0.0, 0.0],
                # Only of the relabelled task, a loss counts.
                "progress": [0.75 * 0.4, 0.75 * -0.4, 0.0],
                "completion": [1.0 - 0.25 * 0.4 - 0.75 * 0.4, 0.0, 0.0],
            },
        ),
    ],
)
def test_the_terms_of_a_reward(name, expected):
    def terms(shares, completions):
        step = types.SimpleNamespace(shares=shares, completions=completions)
        with np.errstate(all="raise"):
            return {term: formula(step) for term, formula in reward.REWARDS[name].items()}

    together = terms(SHARES, COMPLETIONS)
    assert tuple(together) == tuple(expected)
    for term, values in expected.items():
        assert together[term].dtype == np.float64
        np.testing.assert_allclose(together[term], values, rtol=1e-12, atol=1e-15, err_msg=term)
    for episode in range(3):
        for term, value in terms(alone(SHARES, episode), COMPLETIONS[episode]).items():
            assert np.shape(value) == ()
            np.testing.assert_allclose(value, together[term][episode], rtol=1e-12, atol=1e-15, err_msg=term)


def test_a_task_that_is_completed_has_been_paid_one_in_all():
    # The potential is 0.25 * 0.4 + 0.75 * 0.4 before the step that completes the third task.
    step = types.SimpleNamespace(shares=alone(SHARES, 0))
    completion = reward.REWARDS["dense_gain"]["completion"](step)
    assert completion + 0.25 * 0.4 + 0.75 * 0.4 == pytest.approx(1.0)


def test_there_are_three_rewards_and_only_dense_goes_on():
    assert tuple(reward.REWARDS) == ("sparse", "dense", "dense_gain")
    assert {"dense"} == reward.CONTINUING

"""The mathematics of the open_cabinet domain: leading axes, limits, signs."""

import numpy as np
import pytest
from helpers.open_cabinet import reward_terms

from kitchen_suite.tasks.control_modes import joints as actions
from kitchen_suite.tasks.open_cabinet import observation
from kitchen_suite.tasks.open_cabinet import rewards as reward
from kitchen_suite.tasks.open_cabinet.features import Features


def random_features(shape, seed=0):
    random = np.random.default_rng(seed)

    def quaternions():
        raw = random.normal(size=(*shape, 4))
        return raw / np.linalg.norm(raw, axis=-1, keepdims=True)

    return Features.of(
        joint_positions=random.uniform(-3, 3, (*shape, 9)),
        joint_velocities=random.normal(size=(*shape, 9)) * 2,
        tcp_position=random.uniform(-0.02, 0.02, (*shape, 3)),
        tcp_quaternion=quaternions(),
        handle_position=random.uniform(-0.02, 0.02, (*shape, 3)),
        handle_quaternion=quaternions(),
        left_pad_height=random.uniform(-0.1, 0.1, shape),
        right_pad_height=random.uniform(-0.1, 0.1, shape),
        drawer_position=random.uniform(-0.1, 0.4, shape),
        drawer_velocity=random.normal(size=shape),
    )


def changed(features, **parts):
    return Features.of(**{**features.arrays(), **parts})


def row(batch, i):
    return Features(batch.values[i])


def test_a_batch_and_its_rows_have_equal_observations_and_rewards():
    batch = random_features((50,))
    random = np.random.default_rng(1)
    gripper, change, steps = random.choice([0.0, 0.04], 50), random.normal(size=(50, 8)), random.integers(0, 16_000, 50)
    terminated = reward.terminates(batch)
    rewards = reward.REWARDS["original"]
    terms = reward_terms(
        rewards, batch, gripper=gripper, action_change=change, total_steps=steps, terminated=terminated
    )
    for i in range(50):
        alone = row(batch, i)
        np.testing.assert_array_equal(observation.observe(alone), observation.observe(batch)[i])
        assert reward.terminates(alone) == terminated[i]
        single = reward_terms(
            rewards,
            alone,
            gripper=gripper[i],
            action_change=change[i],
            total_steps=int(steps[i]),
            terminated=reward.terminates(alone),
        )
        for name, term in single.items():
            assert term.shape == ()
            assert terms[name].shape == (50,)
            np.testing.assert_allclose(term, terms[name][i], rtol=1e-13, atol=1e-15)


def test_parts_end_to_end_are_the_flat_vector():
    batch = random_features((3, 2))
    flat = observation.observe(batch)
    assert flat.shape == (3, 2, 25)
    assert observation.SIZE == 25
    stops = [part.stop for part in observation.SLICES.values()]
    assert [part.start for part in observation.SLICES.values()] == [0, *stops[:-1]]
    computed = {name: compute(batch) for name, compute in observation.QUANTITIES.items()}
    assert list(computed) == list(observation.SLICES)
    assert all((flat[..., observation.SLICES[name]] == values).all() for name, values in computed.items())
    clipped = observation.clipped(flat * 100)
    assert clipped.dtype == np.float32
    assert abs(clipped).max() == 5


def test_equal_orientations_have_no_offset_whatever_their_signs():
    batch = changed(random_features((20,)), drawer_position=np.zeros(20))
    for sign in (-1, 1):
        same = changed(batch, tcp_quaternion=sign * batch.handle_quaternion)
        np.testing.assert_allclose(observation.handle_orientation_offset(same), 0, atol=1e-15)
        np.testing.assert_allclose(reward.orientation(same), 1)


def test_the_sign_of_no_quaternion_matters():
    batch = random_features((20,))
    for name in ("tcp_quaternion", "handle_quaternion"):
        turned = changed(batch, **{name: -getattr(batch, name)})
        np.testing.assert_array_equal(
            observation.handle_orientation_offset(turned), observation.handle_orientation_offset(batch)
        )
        np.testing.assert_allclose(reward.orientation(turned), reward.orientation(batch), atol=1e-12)


def test_orientation_is_the_cosine_of_the_angle_between_the_frames():
    angle = 0.7
    turned = np.array([np.cos(angle / 2), np.sin(angle / 2), 0, 0])
    closed = changed(
        row(random_features((1,)), 0),
        tcp_quaternion=turned,
        handle_quaternion=np.array([1.0, 0, 0, 0]),
        drawer_position=np.array(0.0),
    )
    np.testing.assert_allclose(reward.orientation(closed), np.cos(angle), rtol=1e-12)


def test_closing_is_the_logistic_function_without_overflow():
    logits = np.array([-30.0, -1.5, 0.0, 2.0, 30.0])
    np.testing.assert_allclose(actions.closing_probability(logits), 1 / (1 + np.exp(-logits)), rtol=1e-12)
    with np.errstate(all="raise", under="ignore"):
        np.testing.assert_array_equal(actions.closing_probability(np.array([-1e300, 1e300])), [0, 1])


def test_a_deterministic_gripper_closes_on_positive_actions():
    np.testing.assert_array_equal(actions.gripper_target(np.array([-1.0, 0.0, 1e-6])), [0.04, 0.04, 0.0])


def test_arm_targets_stay_within_the_limits():
    target = actions.arm_target(np.zeros((2, 7)), np.array([[1e9] * 7, [-1e9] * 7]))
    np.testing.assert_array_equal(target, [actions.JOINT_HIGH[:7], actions.JOINT_LOW[:7]])


@pytest.mark.parametrize(("total_steps", "action", "velocity"), [(0, 1e-3, 0), (7_999, 1e-3, 0), (8_000, 2e-3, 2e-7)])
def test_penalties_grow_at_step_8000(total_steps, action, velocity):
    assert reward.penalty_coefficients(total_steps) == (action, velocity)


def test_success_begins_at_thirty_centimetres():
    np.testing.assert_array_equal(reward.succeeds(np.array([0.0, 0.2999, 0.3, 0.4])), [False, False, True, True])

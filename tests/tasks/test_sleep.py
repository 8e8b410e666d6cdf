"""Objects at rest may be put to sleep: nearly the same trajectories, and contact wakes them."""

import gymnasium
import numpy as np
import pytest
from reference import random_actions

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import KITCHEN_ID

STEPS = 140
# With these actions the robot runs into the kettle after 104 steps.
SEED = 2


def load(**options):
    quiet = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0, "visuals": False}
    return suite.load("kitchen", "all", {"random": 0, **quiet, **options})


@pytest.fixture(scope="module")
def episode():
    """Positions and sleeping trees after every control step, and the positions without sleep."""
    sleepy, awake = load(sleep=True), load()
    sleepy.reset(), awake.reset()
    positions, asleep, reference = [], [], []
    for action in random_actions(np.random.default_rng(SEED), 280)[:STEPS]:
        sleepy.step(action), awake.step(action)
        positions.append(sleepy.physics.data.qpos.copy())
        asleep.append(sleepy.physics.data.ptr.tree_asleep >= 0)
        reference.append(awake.physics.data.qpos.copy())
    trees = sleepy.physics.model.dof_treeid
    return np.array(positions), np.array(asleep), np.array(reference), trees


def test_all_but_the_robot_falls_asleep(episode):
    _, asleep, _, trees = episode
    assert asleep[50, 1:].all()
    assert not asleep[:, trees[:9]].any()


def test_until_something_is_touched_trajectories_are_nearly_the_same(episode):
    positions, _, reference, _ = episode
    np.testing.assert_allclose(positions[:100], reference[:100], rtol=0, atol=1e-7)
    np.testing.assert_allclose(positions[:100, :9], reference[:100, :9], rtol=0, atol=1e-12)


def test_what_is_touched_wakes_and_moves_and_the_rest_stays(episode):
    positions, asleep, _, trees = episode
    kettle = trees[-1]
    assert asleep[100, kettle]
    assert not asleep[105:110, kettle].all()
    moved = np.abs(positions[-1] - positions[100])
    assert moved[23:26].max() > 1e-3
    assert moved[9:22].max() == 0.0


def test_nothing_sleeps_unless_asked_to():
    environment = load()
    environment.reset()
    for _ in range(60):
        environment.step(np.zeros(9))
    assert not (environment.physics.data.ptr.tree_asleep >= 0).any()


def test_sleeping_kitchens_can_be_vectorised_and_start_awake_again():
    options = {"sleep": True, "max_episode_steps": 30, "robot_noise_ratio": 0.0}
    many = gymnasium.make_vec(KITCHEN_ID, 2, "vector_entry_point", **options)
    one = gymnasium.make(KITCHEN_ID, **options)
    np.testing.assert_array_equal(many.reset(seed=0)[0]["observation"][0], one.reset(seed=0)[0]["observation"])
    for action in random_actions(np.random.default_rng(SEED), 70):
        seen, *_ = many.step(np.stack([action, -action]))
        if one.get_wrapper_attr("_elapsed_steps") == 30:
            expected, _ = one.reset()
        else:
            expected, *_ = one.step(action)
        np.testing.assert_array_equal(seen["observation"][0], expected["observation"])


def test_sleep_must_be_a_bool():
    with pytest.raises(TypeError, match="sleep must be True or False, got 1"):
        load(sleep=1)

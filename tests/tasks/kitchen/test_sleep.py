"""Objects at rest may be put to sleep: nearly the same trajectories, and contact wakes them."""

import gymnasium
import numpy as np
import pytest
from helpers.original import random_actions
from helpers.sweeps import brief

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


@pytest.mark.full
def test_all_but_the_robot_falls_asleep(episode):
    _, asleep, _, trees = episode
    assert asleep[50, 1:].all()
    assert not asleep[:, trees[:9]].any()


@pytest.mark.full
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


@pytest.mark.full
def test_nothing_sleeps_unless_asked_to():
    environment = load()
    environment.reset()
    for _ in range(60):
        environment.step(np.zeros(9))
    assert not (environment.physics.data.ptr.tree_asleep >= 0).any()


@pytest.mark.full
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


@pytest.mark.full
def test_sleep_must_be_a_bool():
    with pytest.raises(TypeError, match="sleep must be True or False, got 1"):
        load(sleep=1)


@pytest.mark.full
def test_furniture_that_the_layout_moves_is_where_it_is_without_sleep():
    options = {"variations": ["layout", "start"], "random": 3}
    sleepy, awake = load(sleep=True, **options), load(**options)
    # The second episode has another layout, and starts after objects have slept in the first one.
    for _ in range(2):
        for environment in (sleepy, awake):
            environment.reset()
        for action in random_actions(np.random.default_rng(SEED), 280)[:30]:
            sleepy.step(action), awake.step(action)
        for poses in ("xpos", "geom_xpos", "site_xpos"):
            found, expected = (getattr(environment.physics.data, poses) for environment in (sleepy, awake))
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


# Doors as far as a start displaces them, and a kettle moved and turned.
FAR = {
    "hinge_cabinet/doors": (-0.2, 0.8),
    "microwave/door": -0.38,
    "kettle/pose": (0.03, -0.03, 0.3),
}


@pytest.mark.full
@pytest.mark.parametrize("seed", brief([0, 1], kept=[1]))
def test_episodes_with_other_starts_and_dynamics_are_nearly_the_same(seed):
    options = {"random": seed, "variations": ["start", "dynamics"], "variation_split": "held_out"}
    sleepy, awake = load(sleep=True, **options), load(**options)
    # The second episode starts after objects have slept in the first one.
    for _ in range(2):
        for environment in (sleepy, awake):
            environment.task.follow(environment.task.checked_reset({"variation_values": FAR}))
            environment.reset()
        np.testing.assert_array_equal(sleepy.physics.data.qpos, awake.physics.data.qpos)
        doors = sleepy.physics.bind(sleepy.task.scene.props["hinge_cabinet"].joints).qpos
        # Displaced from where they start by default, nearly closed.
        np.testing.assert_allclose(doors, FAR["hinge_cabinet/doors"], atol=0.01)
        for action in random_actions(np.random.default_rng(SEED), 280)[:60]:
            sleepy.step(action), awake.step(action)
            np.testing.assert_allclose(sleepy.physics.data.qpos, awake.physics.data.qpos, rtol=0, atol=1e-7)
            # Also where objects that sleep are seen and touched.
            np.testing.assert_allclose(sleepy.physics.data.xpos, awake.physics.data.xpos, rtol=0, atol=1e-7)
        trees = sleepy.physics.model.dof_treeid
        asleep = sleepy.physics.data.ptr.tree_asleep >= 0
        doors = sleepy.physics.bind(sleepy.task.scene.props["hinge_cabinet"].joints).dofadr
        assert asleep[trees[-1]], "the kettle"
        assert asleep[trees[doors]].all(), "the doors"


@pytest.mark.full
def test_a_displaced_kettle_that_sleeps_wakes_where_it_stands():
    # With these actions the robot runs into the kettle, wherever it stands.
    values = {"kettle/pose": (0.01, -0.02, 0.2)}
    sleepy, awake = load(sleep=True, variations=values), load(variations=values)
    for environment in (sleepy, awake):
        environment.reset()
    slept, start = False, None
    kettle = sleepy.task.scene.props["kettle"].joints
    tree = sleepy.physics.model.dof_treeid[-1]
    for action in random_actions(np.random.default_rng(SEED), 280)[:STEPS]:
        sleepy.step(action), awake.step(action)
        is_asleep = sleepy.physics.data.ptr.tree_asleep[tree] >= 0
        position = np.array(sleepy.physics.bind(kettle).qpos[:3])
        if is_asleep and not slept:
            slept, start = True, position
    assert slept
    assert np.abs(position - start).max() > 1e-3
    reference = awake.physics.bind(awake.task.scene.props["kettle"].joints).qpos[:3]
    # Contacts amplify the difference; both were pushed the same way.
    np.testing.assert_allclose(position, reference, rtol=0, atol=2e-2)

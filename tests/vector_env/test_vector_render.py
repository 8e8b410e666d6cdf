"""Images of vectorised environments: equal to the single environment's, without effect on the episodes."""

import gymnasium
import numpy as np
import pytest
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.open_cabinet import VARIED

from kitchen_suite.gymnasium_env import KITCHEN_ID, OPEN_CABINET_ID
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

pytestmark = pytest.mark.full

SMALL = {"width": 96, "height": 64}
# Without visual geoms: for tests that do not look at the robot.
BARE = {**SMALL, "visuals": False}
DRAWN = {KITCHEN_ID: {}, OPEN_CABINET_ID: {"variations": VARIED}}


def many(env_id, count, **settings):
    return gymnasium.make_vec(
        env_id, count, vectorization_mode="vector_entry_point", num_threads=1, **DRAWN[env_id], **settings
    )


def actions_for(env, steps):
    # Far enough that no two robots look alike.
    scale = 1.0 if env.single_action_space.shape == (9,) else 0.1
    return np.random.default_rng(0).normal(scale=scale, size=(steps, *env.action_space.shape))


@pytest.mark.rendering
@pytest.mark.parametrize(
    ("env_id", "camera"), [pytest.param(KITCHEN_ID, "overview", marks=pytest.mark.nightly), (OPEN_CABINET_ID, None)]
)
def test_pictures_are_those_of_the_single_environments(env_id, camera):
    settings = {**SMALL, "camera_name": camera, "render_mode": "rgb_array"}
    env, single = many(env_id, 3, **settings), gymnasium.make(env_id, **settings, **DRAWN[env_id])
    actions = actions_for(env, 5)
    env.reset(seed=0)
    for action in actions:
        env.step(action)
    expected = []
    for i in (2, 0):
        single.reset(seed=i)
        for action in actions:
            single.step(action[i])
        expected.append(single.render())
    pictures = env.render()
    assert isinstance(pictures, tuple)
    assert [(picture.shape, picture.dtype) for picture in pictures] == [((64, 96, 3), np.uint8)] * 3
    assert len({picture.tobytes() for picture in pictures}) == 3
    np.testing.assert_array_equal(env.render_some([2, 0]), expected)
    # Images returned before stay as they were.
    np.testing.assert_array_equal([pictures[2], pictures[0]], expected)
    env.close()
    single.close()


@pytest.mark.rendering
def test_rendering_leaves_no_trace_in_the_episodes():
    seen, unseen = (
        many(OPEN_CABINET_ID, 3, max_episode_steps=3, render_mode=mode, **BARE) for mode in ("rgb_array", None)
    )
    assert_same(seen.reset(seed=0), unseen.reset(seed=0))
    for number, action in enumerate(actions_for(seen, 9)):
        seen.render_some([number % 3])
        assert_same(seen.step(action), unseen.step(action))
        if number == 4:
            options = {"reset_mask": np.array([False, True, False])}
            assert_same(seen.reset(options=options), unseen.reset(options=options))
    seen.close()


@pytest.mark.rendering
def test_depth_is_the_single_environments():
    env = many(OPEN_CABINET_ID, 2, render_mode="depth_array", **BARE)
    single = gymnasium.make(OPEN_CABINET_ID, render_mode="depth_array", **BARE, **DRAWN[OPEN_CABINET_ID])
    env.reset(seed=0)
    single.reset(seed=1)
    env.step(np.ones((2, 8)))
    single.step(np.ones(8))
    (depth,) = env.render_some([1])
    assert (depth.shape, depth.dtype) == ((64, 96), np.float32)
    np.testing.assert_array_equal(depth, single.render())
    env.close()
    single.close()


@pytest.mark.rendering
def test_any_integers_choose_what_is_shown_and_all_else_is_refused():
    env = FrankaOpenCabinetVectorEnv(2, render_mode="rgb_array", **BARE)
    env.reset(seed=0)
    assert env.render_some([]) == ()
    assert len(env.render_some(i for i in np.array([1, 1, 0]))) == 3
    for indices, error in (
        ([0, 2], IndexError),
        ([-3], IndexError),
        ([0.5], TypeError),
        (["0"], TypeError),
        (1, TypeError),
    ):
        with pytest.raises(error):
            env.render_some(indices)
    env.close()


def test_without_a_render_mode_rendering_warns_and_returns_none():
    env = FrankaKitchenVectorEnv(2, num_threads=1)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    with refused(ValueError, "render_mode"):
        env.render_some([0])

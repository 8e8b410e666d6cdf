"""The cabinet's expert opens either drawer from observations alone, from any initial state."""

import numpy as np
import pytest
from helpers.episodes import play
from helpers.open_cabinet import VARIED
from helpers.sweeps import brief, brief_named

from kitchen_suite import experts, policies, suite
from kitchen_suite.gymnasium_env import FrankaOpenCabinetEnv

DRAWERS = ("top", "bottom")
STYLES = {
    "slow": experts.MotionStyle(speed=0.6),
    "noisy": experts.MotionStyle(action_noise=0.001),
    "jittered": experts.MotionStyle(jitter=0.02),
}


def load(drawer="top", **task_kwargs):
    return suite.load("open_cabinet", f"{drawer}_drawer", {"visuals": False, **task_kwargs})


def opening(env, expert, seed):
    """Opening of the drawer at the end of an episode [m], 0 if it was terminated, and all actions."""
    env.random_state.seed(seed)
    timestep = env.reset()
    expert.reset(np.random.default_rng(seed))
    actions = []
    while not timestep.last():
        actions.append(expert.act(np.concatenate([*timestep.observation.values()])))
        timestep = env.step(actions[-1])
    return env.task.drawer_opening * timestep.discount, np.array(actions)


@pytest.mark.full
@pytest.mark.parametrize("seed", brief([201, 202, 203], kept=[201]))
@pytest.mark.parametrize("drawer", DRAWERS)
def test_the_policy_opens_the_drawer(drawer, seed):
    env = load(drawer)
    actions = play(env, policies.find("expert"), seed)
    assert env.task.episode_metrics["success"], env.task.episode_metrics
    assert len(actions) == 700


@pytest.mark.full
@pytest.mark.parametrize("drawer", brief(DRAWERS, kept=["bottom"]))
def test_the_flat_observation_alone_is_enough_to_open_it(drawer):
    env, expert = FrankaOpenCabinetEnv(drawer=drawer, max_episode_steps=700), experts.DrawerExpert(drawer)
    observation, _ = env.reset(seed=204)
    expert.reset(np.random.default_rng(0))
    terminated = truncated = False
    while not terminated and not truncated:
        action = expert.act(observation)
        assert env.action_space.contains(action)
        observation, _, terminated, truncated, info = env.step(action)
    assert not terminated
    assert info["is_success"]


@pytest.mark.full
@pytest.mark.parametrize("style", brief_named(STYLES, kept=["slow", "jittered"]))
@pytest.mark.parametrize("drawer", brief(DRAWERS, kept=["top"]))
def test_a_motion_style_changes_the_actions_and_still_opens_the_drawer(drawer, style):
    env = load(drawer)
    styled, actions = opening(env, experts.make(env.task, style=style), 205)
    _, plain = opening(env, experts.make(env.task), 205)
    assert styled >= 0.3
    assert not np.array_equal(actions, plain)


@pytest.mark.full
def test_a_seed_fixes_all_actions_at_the_cabinet():
    # Until the hand pulls.
    env = load(time_limit=5.0)
    expert = experts.make(env.task, style=experts.MotionStyle(jitter=0.02, action_noise=0.001))
    first, other, again = (opening(env, expert, seed)[1] for seed in (206, 207, 206))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.full
@pytest.mark.parametrize("seed", brief([208, 209, 210], kept=[208]))
def test_a_displaced_handle_is_found_under_observation_noise(seed):
    env = load(
        observation_noise={"handle_offset": 0.01, "handle_orientation_offset": 0.02},
        variations=VARIED,
    )
    assert opening(env, experts.make(env.task), seed)[0] >= 0.3


@pytest.mark.full
def test_a_drawer_that_slipped_out_is_grasped_again():
    env = load(gripper="deterministic")
    env.random_state.seed(0)
    timestep, expert = env.reset(), experts.make(env.task)
    for step in range(700):
        action = expert.act(np.concatenate([*timestep.observation.values()]))
        # The fingers open during the pull.
        action[7] = -1.0 if 180 <= step < 240 else action[7]
        timestep = env.step(action)
        if step == 240:
            assert env.task.drawer_opening < 0.2
    assert env.task.drawer_opening >= 0.3


@pytest.mark.nightly
@pytest.mark.parametrize("drawer", DRAWERS)
def test_a_hundred_unseen_starts(drawer):
    env = load(drawer)
    expert = experts.make(env.task)
    assert sum(opening(env, expert, 20_000 + seed)[0] >= 0.3 for seed in range(100)) >= 98

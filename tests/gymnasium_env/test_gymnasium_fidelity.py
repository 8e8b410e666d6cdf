"""The adapter against the original environment, run live with the same arguments, seeds and actions."""

import numpy as np
import pytest
from helpers.original import original_environment, random_actions
from helpers.sweeps import brief_named

from kitchen_suite.gymnasium_env import FrankaKitchenEnv

STEPS = 280
QUIET = {"object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}
# With these seeds of `random_actions` the kettle is pushed into its goal in the middle of the episode.
COMBINATIONS = {
    "defaults": {},
    "one task, terminating": {"tasks_to_complete": ["kettle"]},
    "kept, not terminating": {"remove_task_when_completed": False, "terminate_on_tasks_completed": False},
    "kept, terminating": {"tasks_to_complete": ["microwave", "kettle"], "remove_task_when_completed": False},
    "removed, not terminating, quiet": {
        "tasks_to_complete": ["kettle", "slide cabinet", "microwave"],
        "terminate_on_tasks_completed": False,
        **QUIET,
    },
}
LISTS = ("tasks_to_complete", "step_task_completions", "episode_task_completions")


def assert_goals_equal(one, other):
    assert one.keys() == other.keys()
    for task in one:
        np.testing.assert_array_equal(one[task], other[task])


def assert_observations_equal(one, other):
    np.testing.assert_array_equal(one["observation"], other["observation"])
    assert one["observation"].dtype == other["observation"].dtype == np.float64
    for kind in ("achieved_goal", "desired_goal"):
        assert_goals_equal(one[kind], other[kind])


@pytest.mark.full
@pytest.mark.parametrize(
    "arguments", brief_named(COMBINATIONS, kept=["defaults", "kept, terminating", "removed, not terminating, quiet"])
)
@pytest.mark.parametrize("seed", [3, pytest.param(2**35 + 1, marks=pytest.mark.nightly)])
def test_every_step_of_an_episode_is_the_originals(arguments, seed):
    ours = FrankaKitchenEnv(**arguments)
    completed_before = []
    with original_environment(**arguments) as original:
        here, there = ours.reset(seed=seed), original.reset(seed=seed)
        assert_observations_equal(here[0], there[0])
        for action in random_actions(np.random.default_rng(seed % 7), STEPS):
            here, there = ours.step(action), original.step(action)
            lists = {name: list(there[4][name]) for name in LISTS}
            assert_observations_equal(here[0], there[0])
            assert here[1:4] == tuple(there[1:4])
            assert here[1] == ours.compute_reward(here[0]["achieved_goal"], here[0]["desired_goal"], here[4])
            assert here[2] == ours.compute_terminated(here[0]["achieved_goal"], here[0]["desired_goal"], here[4])
            for name in LISTS:
                assert set(here[4][name]) == set(lists[name])
                assert len(here[4][name]) == len(lists[name])
            assert here[4]["episode_task_completions"][: len(completed_before)] == completed_before
            completed_before = here[4]["episode_task_completions"]


@pytest.mark.full
def test_the_combinations_complete_a_task_on_the_way():
    ours = FrankaKitchenEnv()
    ours.reset(seed=3)
    infos = [ours.step(action)[4] for action in random_actions(np.random.default_rng(3), STEPS)]
    assert 1 < infos[-1]["completion_steps"].max() < STEPS


@pytest.mark.full
def test_the_stream_goes_on_through_resets_without_a_seed():
    ours = FrankaKitchenEnv()
    with original_environment() as original:
        for seed in (5, None, None, 6, None):
            assert_observations_equal(ours.reset(seed=seed)[0], original.reset(seed=seed)[0])
            for action in random_actions(np.random.default_rng(1), 5):
                assert_observations_equal(ours.step(action)[0], original.step(action)[0])


@pytest.mark.full
def test_spaces_are_the_originals_but_for_float32_actions():
    ours = FrankaKitchenEnv(tasks_to_complete=["kettle", "light switch"])
    with original_environment(tasks_to_complete=["kettle", "light switch"]) as original:
        assert ours.observation_space == original.observation_space
        assert ours.action_space.shape == original.action_space.shape
        np.testing.assert_array_equal(ours.action_space.low, original.action_space.low)
        np.testing.assert_array_equal(ours.action_space.high, original.action_space.high)
        assert ours.action_space.dtype == np.float32

"""Vectorised kitchens whose environments each ask for tasks of their own."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

ARGUMENTS = {"tasks_per_episode": (1, 4), "threshold": 0.9, "reward": "dense_gain", "goal_format": "flat"}
COUNT, STEPS, LIMIT = 3, 9, 4
KEYS = ("requested_tasks", "tasks_to_complete", "episode_task_completions", "requested_order", "is_success")


def make(mode="SameStep", **arguments):
    return FrankaKitchenVectorEnv(COUNT, autoreset_mode=mode, num_threads=1, **{**ARGUMENTS, **arguments})


def single_episodes(i, actions, mode, arguments):
    """Returns observation, reward, infos and sentence after each call of environment `i`, played alone."""
    env, needs_reset = FrankaKitchenEnv(max_episode_steps=LIMIT, **ARGUMENTS, **arguments), False
    observation, info = env.reset(seed=7 + i)
    rows = [(observation, 0.0, info, env.instruction)]
    for action in actions:
        if needs_reset and mode != AutoresetMode.SAME_STEP:
            observation, info = env.reset()
            reward, needs_reset = 0.0, False
            rows.append((observation, reward, info, env.instruction))
            if mode == AutoresetMode.NEXT_STEP:
                continue
            rows.pop()
        observation, reward, terminated, truncated, info = env.step(action)
        needs_reset = terminated or truncated
        if needs_reset and mode == AutoresetMode.SAME_STEP:
            observation, info = env.reset()
        rows.append((observation, reward, info, env.instruction))
    return rows


@pytest.mark.full
@pytest.mark.parametrize(
    "arguments",
    [{}, pytest.param({"tasks_in_turn": True}, marks=pytest.mark.full)],
    ids=["at once", "in turn"],
)
@pytest.mark.parametrize("mode", brief(AutoresetMode, [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP]))
def test_every_environment_is_the_single_one_of_its_seed(mode, arguments):
    envs = make(mode, max_episode_steps=LIMIT, **arguments)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, COUNT, 9)).astype(np.float32)
    expected = [single_episodes(i, actions[:, i], mode, arguments) for i in range(COUNT)]
    observations, infos = envs.reset(seed=7)
    rewards, ended = np.zeros(COUNT), np.zeros(COUNT, bool)
    for step in range(STEPS + 1):
        if step:
            if mode == AutoresetMode.DISABLED and ended.any():
                envs.reset(options={"reset_mask": ended})
            observations, rewards, terminations, truncations, infos = envs.step(actions[step - 1])
            ended = terminations | truncations
        for i in range(COUNT):
            observation, reward, info, instruction = expected[i][step]
            for key, array in observation.items():
                np.testing.assert_array_equal(observations[key][i], array)
            assert rewards[i] == reward
            for key in KEYS:
                np.testing.assert_array_equal(infos[key][i], info[key])
            assert envs.instruction[i] == envs.get_attr("task")[i] == instruction
            assert envs.get_attr("instructions")[i][0] == instruction


def test_a_reset_asks_for_given_tasks_in_some_environments():
    envs = make()
    _, expected = envs.reset(seed=7)
    _, infos = envs.reset(seed=7, options={"requested_tasks": [["kettle", "microwave"], None, ["light switch"]]})
    drawn = expected["requested_tasks"][1]
    assert [*infos["requested_tasks"]] == [["kettle", "microwave"], drawn, ["light switch"]]
    mask = np.array([False, False, True])
    options = {"reset_mask": mask, "requested_tasks": np.eye(7, dtype=bool)[[0, 0, 6]]}
    _, infos = envs.reset(options=options)
    assert infos["requested_tasks"][2] == ["kettle"]
    assert infos["requested_tasks"][0] is None
    assert envs.instruction[0] == "move the kettle to the top left burner, then open the microwave door"


@pytest.mark.full
def test_weights_of_the_template_are_those_of_later_episodes():
    envs = make(max_episode_steps=2, tasks_per_episode=1, info_format="arrays")
    envs.reset(seed=0)
    envs.composer_task.task_weights = dict.fromkeys(("kettle", "microwave"), 0.0)
    actions = np.zeros((COUNT, 9), np.float32)
    seen = np.zeros(7, bool)
    for step in range(30):
        observations, *_ = envs.step(actions)
        if step:
            seen |= observations["requested_tasks"].any(axis=0)
    assert seen.tolist() == [True] * 5 + [False] * 2


@pytest.mark.full
def test_bad_requests_are_refused_and_change_nothing():
    envs = make()
    envs.reset(seed=0)
    before = envs.instruction
    for request, error, message in (
        (["kettle", "microwave"], ValueError, "one element for each of 3 environments, got 2"),
        (["kettle", "microwave", "kettle"], TypeError, "sequence of names"),
        ("kettle", TypeError, "one element for each environment"),
        ([["kettl"], None, None], ValueError, "did you mean 'kettle'"),
    ):
        with pytest.raises(error, match=message):
            envs.reset(options={"requested_tasks": request})
    assert envs.instruction == before
    plain = FrankaKitchenVectorEnv(2, num_threads=1)
    with refused(ValueError, "tasks_per_episode"):
        plain.reset(options={"requested_tasks": [["kettle"], None]})


@pytest.mark.full
def test_rewards_of_relabelled_goals_are_of_the_tasks_asked():
    envs = make(reward="sparse", threshold=0.3)
    envs.reset(seed=0, options={"requested_tasks": [["kettle"], ["microwave", "kettle"], ["top burner"]]})
    observations, *_, infos = envs.step(np.zeros((COUNT, 9), np.float32))
    reached = observations["achieved_goal"]
    assert envs.compute_reward(reached, reached, infos).tolist() == [1.0, 2.0, 1.0]

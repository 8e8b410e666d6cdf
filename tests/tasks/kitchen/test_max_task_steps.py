"""Kitchens that truncate an episode in which no task is completed for some control steps."""

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

# The first task is complete after the first step; the second and the third never are.
ASKED = ["kettle", "microwave", "top burner"]
ARGUMENTS = {
    "tasks_to_complete": ASKED,
    "tasks_per_episode": 3,
    "tasks_in_turn": True,
    "threshold": {"kettle": 10.0, "microwave": 0.001, "top burner": 0.001},
}
LIMIT = 3
STANDING = np.zeros(9, np.float32)
REQUEST = {"requested_tasks": ASKED}


def limited(**arguments):
    env = FrankaKitchenEnv(max_task_steps=LIMIT, **ARGUMENTS, **arguments)
    env.reset(seed=0, options=REQUEST)
    return env


def test_the_limit_counts_from_the_last_completion():
    env = limited()
    for step in range(1, 6):
        observation, _, terminated, truncated, info = env.step(STANDING)
        assert (terminated, truncated) == (False, step >= 1 + LIMIT)
        assert info["completion_steps"].tolist() == [1, -1, -1]
        goals = observation["achieved_goal"], observation["desired_goal"]
        assert env.compute_truncated(*goals, info) == truncated
        assert env.compute_terminated(*goals, info) == terminated


@pytest.mark.full
def test_the_limit_counts_from_the_reset_where_nothing_is_completed():
    env = limited()
    for _ in range(2):
        env.reset(seed=1, options={"requested_tasks": ["microwave", "top burner"]})
        assert [env.step(STANDING)[3] for _ in range(LIMIT)] == [False, False, True]


def test_the_time_limit_stays():
    env = limited(max_episode_steps=2)
    assert [env.step(STANDING)[3] for _ in range(2)] == [False, True]


@pytest.mark.full
def test_an_episode_whose_tasks_are_all_completed_terminates_instead():
    env = FrankaKitchenEnv(["kettle"], threshold=10.0, max_task_steps=1)
    env.reset(seed=0)
    assert env.step(STANDING)[2:4] == (True, False)


@pytest.mark.full
def test_of_dm_control_the_last_step_has_discount_1():
    arguments = {**ARGUMENTS, "tasks_per_episode": 1, "threshold": 0.001, "max_task_steps": LIMIT, "visuals": False}
    with suite.load("kitchen", "all", {"random": 0, **arguments}) as environment:
        for _ in range(2):
            environment.reset()
            timesteps = [environment.step(STANDING) for _ in range(LIMIT)]
            assert [timestep.last() for timestep in timesteps] == [False, False, True]
            assert timesteps[-1].discount == 1.0
            assert environment.task.truncates
        assert environment.step(STANDING).first()
        assert not environment.task.truncates


@pytest.mark.full
def test_a_saved_state_keeps_the_count():
    env = limited()
    for _ in range(2):
        env.step(STANDING)
    state = env.get_state()
    other = limited()
    other.reset(options={"state": state})
    assert [other.step(STANDING)[3] for _ in range(2)] == [env.step(STANDING)[3] for _ in range(2)] == [False, True]


@pytest.mark.full
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_vectorised_environments_truncate_as_single_ones_do(mode):
    arguments = {**ARGUMENTS, "max_task_steps": LIMIT, "threshold": {"kettle": 10.0, "microwave": 10.0}}
    envs = FrankaKitchenVectorEnv(3, num_threads=1, autoreset_mode=mode, **arguments)
    singles = [FrankaKitchenEnv(**arguments) for _ in range(3)]
    envs.reset(seed=5)
    for i, env in enumerate(singles):
        env.reset(seed=5 + i)
    ended, count = np.zeros(3, bool), 0
    for _ in range(14):
        _, _, terminations, truncations, _ = envs.step(np.zeros((3, 9), np.float32))
        for i, env in enumerate(singles):
            if ended[i] and mode == "NextStep":
                env.reset()
                terminated = truncated = False
            else:
                *_, terminated, truncated, _ = env.step(STANDING)
            if mode == "SameStep" and (terminated or truncated):
                env.reset()
            assert (terminations[i], truncations[i]) == (terminated, truncated)
        ended = terminations | truncations
        count += truncations.sum()
    assert count > 3


@pytest.mark.full
def test_a_limit_below_one_is_refused():
    with refused(ValueError, "max_task_steps", "1", "0"):
        FrankaKitchenEnv(max_task_steps=0)

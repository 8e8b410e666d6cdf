"""The episodes of the commands are those of environments with `episode_seeds`."""

import gymnasium
import numpy as np
import pytest
from helpers.episodes import load_episode

from kitchen_suite import suite
from kitchen_suite.commands import record, rollout

STEPS = 3
FLAGS = ["--policy=zero", f"--max_episode_steps={STEPS}", "--num_episodes=3", "--seed=6", "--variations=start,dynamics"]
VARIED = {"variations": ["start", "dynamics"]}


def recorded(folder):
    """Returns the observations of three episodes."""
    return [load_episode(folder / f"episode_{k:06d}.npz")[1]["observation/observation"] for k in range(3)]


@pytest.mark.full
@pytest.mark.parametrize("given", [[], ['--task_kwargs={"episode_seeds": true}']])
def test_recorded_episodes_are_those_of_an_environment_of_the_seed(tmp_path, given):
    assert record.main([*FLAGS, "--num_envs=2", f"--output={tmp_path}", *given]) == 0
    env = gymnasium.make(suite.DOMAINS["kitchen"].task_ids["complete"], episode_seeds=True, **VARIED)
    for k, expected in enumerate(recorded(tmp_path)):
        # Of lengths other than those recorded.
        found = [env.reset(seed=6 if k == 0 else None), *(env.step(np.zeros(9)) for _ in range(STEPS + 2 * k))]
        np.testing.assert_array_equal([each[0]["observation"] for each in found][: STEPS + 1], expected)


@pytest.mark.full
@pytest.mark.parametrize("given", [[], ['--task_kwargs={"episode_seeds": true}']])
def test_rollouts_are_those_of_suite_load_with_the_seed(tmp_path, given):
    assert rollout.main([*FLAGS, f"--output={tmp_path}", *given]) == 0
    environment = suite.load("kitchen", "complete", {"random": 6, "episode_seeds": True, **VARIED})
    for k, expected in enumerate(recorded(tmp_path)):
        timesteps = [environment.reset(), *(environment.step(np.zeros(9)) for _ in range(STEPS + 2 * k))]
        joints = [each.observation["franka/joint_positions"] for each in timesteps]
        np.testing.assert_array_equal(joints[: STEPS + 1], expected[:, :9])

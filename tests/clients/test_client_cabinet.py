"""The cabinet with real clients: no line of wrapper."""

import gymnasium
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import OPEN_CABINET_ID

pytestmark = pytest.mark.clients


def test_stable_baselines3_trains_ppo_saves_and_loads(tmp_path):
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    # Stable-Baselines3 insists on finite bounds.
    env = gymnasium.make(OPEN_CABINET_ID, action_limit=1.0)
    agent = PPO("MlpPolicy", env, n_steps=500, batch_size=100, n_epochs=2, seed=0, device="cpu")
    agent.learn(2_000)
    assert agent.num_timesteps == 2_000
    observation, _ = env.reset(seed=1)
    agent.save(tmp_path / "agent")
    action, _ = PPO.load(tmp_path / "agent", device="cpu").predict(observation, deterministic=True)
    np.testing.assert_array_equal(action, agent.predict(observation, deterministic=True)[0])
    assert env.action_space.contains(action)


def test_torchrl_rolls_out_the_same_for_the_same_seed():
    import torch
    from torchrl.envs import GymEnv
    from torchrl.envs.utils import check_env_specs

    def rollout():
        env = GymEnv(f"kitchen_suite.gymnasium_env:{OPEN_CABINET_ID}", action_limit=0.02).auto_register_info_dict()
        check_env_specs(env)
        torch.manual_seed(0)
        env.set_seed(3)
        return env.rollout(20)

    one, other = rollout(), rollout()
    assert one.shape == (20,)
    assert one["next", "observation"].shape == (20, 25)
    assert one["action"].abs().max() <= 0.02
    for key in ("observation", "reward", "reward/approach"):
        assert bool((one["next", key] == other["next", key]).all())


@pytest.mark.parametrize("task", suite.TASKS_BY_DOMAIN["open_cabinet"])
def test_shimmy_takes_the_dm_env_side(task):
    from shimmy import DmControlCompatibilityV0

    env = DmControlCompatibilityV0(suite.load("open_cabinet", task, {"visuals": False, "time_limit": 0.2}))
    assert env.action_space.shape == (8,)
    episodes = []
    for _ in range(2):
        observation, _ = env.reset(seed=7)
        steps = [observation]
        for action in np.random.default_rng(0).normal(scale=0.02, size=(20, 8)):
            observation, reward, terminated, truncated, _ = env.step(action)
            assert np.isfinite(reward)
            steps.append(observation)
        assert (terminated, truncated) == (False, True)
        episodes.append(steps)
    for one, other in zip(*episodes, strict=True):
        for key in one:
            np.testing.assert_array_equal(one[key], other[key])

"""The expert's actions complete the same tasks at the same steps in the original environment."""

import numpy as np
import pytest
from helpers.original import original_environment
from helpers.sweeps import brief

from kitchen_suite import experts
from kitchen_suite.gymnasium_env import FrankaKitchenEnv

TASKS = ["microwave", "kettle", "light switch", "slide cabinet"]


@pytest.mark.full
@pytest.mark.parametrize("seed", brief([5, 2**33 + 1], kept=[2**33 + 1]))
def test_demonstrations_are_the_same_in_the_original(seed):
    ours = FrankaKitchenEnv(tasks_to_complete=TASKS)
    expert = experts.KitchenExpert(TASKS, style=experts.MotionStyle(action_noise=0.05, jitter=0.01))
    expert.reset(np.random.default_rng(seed))
    seen, _ = ours.reset(seed=seed)
    with original_environment(tasks_to_complete=TASKS) as original:
        expected, _ = original.reset(seed=seed)
        terminated = False
        while not terminated and ours.get_state()["step_count"] < 280:
            np.testing.assert_array_equal(seen["observation"], expected["observation"])
            action = expert.act(seen["observation"])
            seen, reward, terminated, _, info = ours.step(action)
            expected, reward_there, terminated_there, _, info_there = original.step(action)
            assert (reward, terminated) == (reward_there, terminated_there)
            assert set(info["step_task_completions"]) == set(info_there["step_task_completions"])
    assert terminated, f"{info['episode_task_completions']}"
    assert set(info_there["episode_task_completions"]) == set(TASKS)

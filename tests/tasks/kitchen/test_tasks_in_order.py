"""Tasks that count only in their sequence, as in the kitchen of SPiRL, SkiLD and SkiMo."""

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv
from kitchen_suite.policies import find
from kitchen_suite.tasks.orders import counted_in_order

SEQUENCE = ["microwave", "kettle", "bottom burner", "light switch"]


def published(within_by_step):
    """Tasks completed in each step by the published rule: a list of those that remain, of which a prefix counts.

    https://github.com/clvrai/skimo, d4rl/d4rl/kitchen/kitchen_envs.py, lines 97 to 118.
    """
    remaining, completions = list(range(within_by_step.shape[1])), []
    for within in within_by_step:
        done, all_before = [], True
        for task in remaining:
            if within[task] and all_before:
                done.append(task)
            all_before = all_before and within[task]
        remaining = [task for task in remaining if task not in done]
        completions.append(done)
    return completions


@pytest.mark.full
def test_the_rule_is_the_published_one():
    generator = np.random.default_rng(0)
    for _ in range(20_000):
        within = generator.random((5, 4)) < generator.choice([0.2, 0.5, 0.8])
        completed, found = np.zeros(4, bool), []
        for row in within:
            new = counted_in_order(row, completed) & ~completed
            found.append(np.flatnonzero(new).tolist())
            completed |= new
        assert found == published(within)


def test_the_rule_has_leading_axes():
    generator = np.random.default_rng(1)
    within, completed = generator.random((2, 3, 5, 4)) < 0.5
    rows = [
        counted_in_order(one, other) for one, other in zip(within.reshape(-1, 4), completed.reshape(-1, 4), strict=True)
    ]
    np.testing.assert_array_equal(counted_in_order(within, completed).reshape(-1, 4), rows)


@pytest.mark.full
@pytest.mark.parametrize("close", [["microwave"], ["kettle"], ["microwave", "bottom burner"], SEQUENCE])
def test_a_task_counts_after_those_before_it(close):
    """Within a threshold of 10 a task is complete from the first step on."""
    env = FrankaKitchenEnv(SEQUENCE, tasks_in_order=True, threshold=dict.fromkeys(close, 10.0))
    env.reset(seed=0)
    observation, reward, terminated, _, info = env.step(np.zeros(9))
    prefix = next((place for place, task in enumerate(SEQUENCE) if task not in close), len(SEQUENCE))
    assert info["step_task_completions"] == SEQUENCE[:prefix]
    assert (reward, terminated) == (prefix, prefix == len(SEQUENCE))
    relabelled = env.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
    assert relabelled == reward


@pytest.mark.full
def test_the_expert_keeps_the_order():
    sequence = ["light switch", "kettle", "microwave"]
    environment = suite.load(
        "kitchen", "all", {"tasks_to_complete": sequence, "tasks_in_order": True, "random": 0, "visuals": False}
    )
    timestep, policy = environment.reset(), find("expert")(environment, np.random.default_rng(0))
    while not timestep.last():
        timestep = environment.step(policy(timestep))
    assert list(environment.task.completion_steps) == sequence
    assert environment.task.episode_metrics["success"]


@pytest.mark.full
def test_bad_arguments_are_refused():
    with refused(ValueError, "tasks_in_order", "tasks_per_episode"):
        FrankaKitchenEnv(tasks_in_order=True, tasks_per_episode=2)
    with refused(TypeError, "tasks_in_order", "1"):
        FrankaKitchenEnv(tasks_in_order=1)

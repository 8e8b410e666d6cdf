"""Measures dense rewards and strict success of the kitchen with its expert.

`python docs/kitchen_rewards.py` prints a table for docs/kitchen.md. Of 3 episodes of each task with dense rewards: the
greatest fall of the potential before completion (mean of five steps), its greatest value before it, and the returns of
the expert and of standing still. Of 20 episodes with strict success: successes, and the median number of control steps
to completion. `python docs/kitchen_rewards.py 1` plays one of each. It needs the extra `experts`.
"""

import statistics
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate
from tqdm import tqdm

from kitchen_suite.experts import KitchenExpert
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import GOALS

# Seeds that were not used for tuning.
FIRST_SEED = 50_000
EPISODES, DENSE_EPISODES = 20, 3
STEPS = 280

# Steps over which the potential is averaged.
_WINDOW = 5

Policy = Callable[[dict[str, Any]], NDArray]


def play(env: FrankaKitchenEnv, seed: int, policy: Policy) -> tuple[NDArray[np.float64], int]:
    """Plays an episode; returns its rewards, and the control step at which the task was completed, or -1."""
    observation, info = env.reset(seed=seed)
    rewards = []
    for _ in range(STEPS):
        observation, reward, terminated, _, info = env.step(policy(observation))
        rewards.append(reward)
        if terminated:
            break
    return np.array(rewards), int(info["completion_steps"].max())


def expert(env: FrankaKitchenEnv) -> Policy:
    """Returns the policy of an expert at the start of an episode."""
    one = KitchenExpert.for_task(env.environment.task)
    return lambda observation: one.act(observation["observation"])


def stand_still(observation: dict[str, Any]) -> NDArray:
    """Returns an action of zeros."""
    del observation
    return np.zeros(9)


def greatest_fall(potential: NDArray[np.float64]) -> float:
    """Returns the greatest fall of the mean over a window below an earlier one."""
    means = np.convolve(potential, np.ones(_WINDOW) / _WINDOW, "valid")
    return float((np.maximum.accumulate(means) - means).max())


def row(task: str, episodes: int) -> list[object]:
    """Returns the measures of a task."""
    seeds = range(FIRST_SEED, FIRST_SEED + min(DENSE_EPISODES, episodes))
    envs = {reward: FrankaKitchenEnv([task], reward=reward) for reward in ("dense", "dense_gain")}
    dense = [play(envs["dense"], seed, expert(envs["dense"])) for seed in seeds]
    still = [play(envs["dense"], seed, stand_still)[0].sum() for seed in seeds]
    gains = [play(envs["dense_gain"], seed, expert(envs["dense_gain"]))[0].sum() for seed in seeds]
    waiting = [play(envs["dense_gain"], seed, stand_still)[0].sum() for seed in seeds]
    strict = FrankaKitchenEnv([task], success="strict")
    steps = [play(strict, FIRST_SEED + number, expert(strict))[1] for number in range(episodes)]
    done = [step for step in steps if step > 0]
    return [
        f"`{task}`",
        f"{max(greatest_fall(rewards[:step]) for rewards, step in dense):.3f}",
        f"{max(rewards[: step - 1].max() for rewards, step in dense):.2f}",
        f"{min(rewards.sum() for rewards, _ in dense):.0f}, {max(still):.1f}",
        f"{min(gains):.3f}, {max(waiting):.3f}",
        f"{statistics.median(step for _, step in dense):.0f}",
        f"{len(done)} of {episodes} ({statistics.median(done) if done else 0:.0f})",
    ]


def main(count: str = str(EPISODES)) -> None:
    """Prints the table."""
    headers = [
        "task",
        "greatest fall",
        "greatest potential before completion",
        "`dense`: expert, standing still",
        "`dense_gain`: expert, standing still",
        "steps, `original`",
        "successes (steps), `strict`",
    ]
    rows = [row(task, int(count)) for task in tqdm(GOALS)]
    print(tabulate(rows, headers, tablefmt="github", disable_numparse=True))


if __name__ == "__main__":
    main(*sys.argv[1:])

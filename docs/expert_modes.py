"""Measures the successes of the scripted experts in every control mode.

`python docs/expert_modes.py` plays 100 episodes of each task in each mode, in as many processes as there are CPUs, and
prints a table for docs/experts.md: successes, and in brackets the median number of control steps to success where that
ends the episode. `python docs/expert_modes.py 5` plays 5 of each. It needs the extra `experts`.
"""

import functools
import multiprocessing
import statistics
import sys
from collections.abc import Iterable

import numpy as np
from tabulate import tabulate
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.environment import Environment
from kitchen_suite.tasks.control_modes.modes import OFFSET_MODES
from kitchen_suite.tasks.kitchen.action import CONTROL_MODES

MODES = {"kitchen": CONTROL_MODES, "open_cabinet": OFFSET_MODES}

# The default lengths of episodes, except for all seven tasks: the hand is slower in the modes that command it.
OPTIONS = {"all": {"time_limit": 36.0}}

# Seeds that were not used for tuning.
FIRST_SEED = 30_000
EPISODES = 100

Episode = tuple[str, str, str, int]


@functools.lru_cache(maxsize=1)
def load(domain: str, task: str, mode: str) -> Environment:
    """Returns an environment; consecutive episodes of a task in a mode share it."""
    return suite.load(domain, task, {"visuals": False, "control_mode": mode, **OPTIONS.get(task, {})})


def play(episode: Episode) -> tuple[bool, int]:
    """Plays an episode; returns whether it was a success, and its control steps."""
    *settings, seed = episode
    environment = load(*settings)
    environment.random_state.seed(seed)
    policy = policies.find("expert")(environment, np.random.default_rng(seed))
    timestep, steps = environment.reset(), 0
    while not timestep.last():
        timestep, steps = environment.step(policy(timestep)), steps + 1
    return bool(environment.task.episode_metrics["success"]), steps


def cell(domain: str, results: Iterable[tuple[bool, int]]) -> str:
    """Returns the table's entry for the episodes of a task in a mode."""
    steps = [steps for success, steps in results if success]
    if domain == "open_cabinet" or not steps:
        return str(len(steps))
    return f"{len(steps)} ({statistics.median(steps):.0f})"


def tasks_of(domain: str) -> list[str]:
    """Returns the tasks to be measured: `partial` is `complete` by another name."""
    return [task for each, task in suite.ALL_TASKS if each == domain and task != "partial"]


def measure(count: int) -> None:
    """Plays `count` episodes of each task in each mode, and prints the tables."""
    cases = [(domain, task, mode) for domain in MODES for task in tasks_of(domain) for mode in MODES[domain]]
    episodes = [(*case, FIRST_SEED + i) for case in cases for i in range(count)]
    with multiprocessing.get_context("spawn").Pool() as pool:
        results = list(tqdm(pool.imap(play, episodes, chunksize=count), total=len(episodes), smoothing=0.0))
    chunks = {case: results[i * count : (i + 1) * count] for i, case in enumerate(cases)}
    for domain, modes in MODES.items():
        rows = [
            (f"`{task}`", *(cell(domain, chunks[domain, task, mode]) for mode in modes)) for task in tasks_of(domain)
        ]
        headers = ("task", *(f"`{mode}`" for mode in modes))
        print(tabulate(rows, headers, tablefmt="github", disable_numparse=True), end="\n\n")


if __name__ == "__main__":
    measure(int(sys.argv[1]) if len(sys.argv) > 1 else EPISODES)

"""Measures the successes of the scripted experts in every control mode.

`python docs/experiments/expert_modes.py` plays 100 episodes of each task in each mode, in as many processes as there
are CPUs, and prints a table for docs/guide/experts.md: successes, and in brackets the median number of control steps to
success where that ends the episode. `python docs/experiments/expert_modes.py 5` plays 5 of each. `python
docs/experiments/expert_modes.py further` does so for the kitchen's tasks beyond the reference's: 100 episodes in the
default mode, and 20 in two others. Both need the extra `experts`.
"""

import functools
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from experiment import Case, make_parser, play, play_cases, positive
from tabulate import tabulate

from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES

MODES = {"kitchen": CONTROL_MODES, "open_cabinet": OFFSET_MODES, "microwave_table": OFFSET_MODES}

# Numbers of episodes by mode, of the kitchen's tasks beyond the reference's.
FURTHER_EPISODES = {"joint_velocity": 100, "joint_delta": 20, "ee_delta_pose": 20}

# The default lengths of episodes, except for all seven tasks: the hand is slower in the modes that command it.
OPTIONS = {"all": {"time_limit": 36.0}}

# Seeds that were not used for tuning.
FIRST_SEED = 30_000
EPISODES = 100


@functools.lru_cache(maxsize=1)
def load(domain: str, task: str, mode: str) -> Environment:
    """Returns an environment; consecutive episodes of a task in a mode share it."""
    return suite.load(domain, task, {"visuals": False, "control_mode": mode, **OPTIONS.get(task, {})})


def play_episode(episode: Case) -> tuple[bool, int]:
    """Plays an episode of a domain, task and mode from a seed; returns whether it succeeded, and its control steps."""
    *settings, seed = episode
    return play(load(*settings), "expert", seed)


def cell(domain: str, results: Iterable[tuple[bool, int]]) -> str:
    """Returns the table's entry for the episodes of a task in a mode."""
    steps = [steps for success, steps in results if success]
    if domain != "kitchen" or not steps:
        return str(len(steps))
    return f"{len(steps)} ({statistics.median(steps):.0f})"


def tasks_of(domain: str) -> list[str]:
    """Returns the tasks to be measured in every mode: `partial` is `complete` by another name.

    Tasks that ask for some of the others in each episode are left out.
    """
    skipped = {"partial", *further_tasks()}
    tasks = suite.DOMAINS[domain].tasks.items()
    return [task for task, arguments in tasks if task not in skipped and "tasks_per_episode" not in arguments]


def further_tasks() -> list[str]:
    """Returns the kitchen's tasks beyond the reference's."""
    return [task.replace(" ", "_") for task in GOALS if task not in DEFAULT_TASKS]


def print_table(domain: str, tasks: Sequence[str], modes: Iterable[str], results: Mapping[Case, Any]) -> None:
    """Prints the table of the results of a domain's tasks."""
    modes = list(modes)
    rows = [(f"`{task}`", *(cell(domain, results[domain, task, mode]) for mode in modes)) for task in tasks]
    headers = ("task", *(f"`{mode}`" for mode in modes))
    print(tabulate(rows, headers, tablefmt="github", disable_numparse=True), end="\n\n")


def measure(count: int) -> None:
    """Plays `count` episodes of each task in each mode, and prints the tables."""
    counts = {(domain, task, mode): count for domain in MODES for task in tasks_of(domain) for mode in MODES[domain]}
    results = play_cases(play_episode, counts, FIRST_SEED)
    for domain, modes in MODES.items():
        print_table(domain, tasks_of(domain), modes, results)


def measure_further() -> None:
    """Plays episodes of the kitchen's tasks beyond the reference's, and prints their table."""
    tasks = further_tasks()
    counts = {("kitchen", task, mode): count for task in tasks for mode, count in FURTHER_EPISODES.items()}
    results = play_cases(play_episode, counts, FIRST_SEED)
    print_table("kitchen", tasks, FURTHER_EPISODES, results)


if __name__ == "__main__":
    parser = make_parser(__doc__)
    parser.add_argument("episodes", nargs="?", default=str(EPISODES), help="of each task in each mode, or further")
    chosen = parser.parse_args().episodes
    if chosen == "further":
        measure_further()
    else:
        measure(positive(chosen))

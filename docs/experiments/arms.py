"""Measures the successes of the scripted expert with other arms in the kitchen.

`python docs/experiments/arms.py` plays 20 episodes of each of the seven tasks in `ee_delta_pose` and 5 in the other
control modes of the end effector, and 2 of each further task in `ee_delta_pose`, with the arms that are tested, one
after the other; it goes on where it was stopped. Rows are in results/arms.json, of which `python
docs/scripts/tables.py` makes the tables of docs/guide/arms.md. It needs the extras `experts` and `arms`, and gym-hil.
"""

import json
import statistics
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

RESULTS = Path(__file__).resolve().parent / "results" / "arms.json"
ROBOTS = ("panda", "ur5e")
# Numbers of episodes by mode, and of a further task.
EPISODES = {"ee_delta_pose": 20, "ee_pose": 5, "ee_delta_position": 5}
FURTHER_MODE, FURTHER_EPISODES = "ee_delta_pose", 2
# Seeds that were not used for tuning.
FIRST_SEED = 30_000


def cases() -> list[tuple[str, str, str, int]]:
    """Returns robot, task, mode and number of episodes of each row, in order."""
    seven = [(robot, task, mode, n) for mode, n in EPISODES.items() for robot in ROBOTS for task in DEFAULT_TASKS]
    others = [task for task in GOALS if task not in DEFAULT_TASKS]
    return seven + [(robot, task, FURTHER_MODE, FURTHER_EPISODES) for robot in ROBOTS for task in others]


def play(robot: str, task: str, mode: str, episodes: int) -> dict[str, Any]:
    """Plays episodes of a task; returns the number of successes, and the median of their control steps."""
    arguments = {"visuals": False, "robot": robot, "control_mode": mode}
    environment = suite.load("kitchen", task.replace(" ", "_"), arguments)
    steps = []
    for seed in range(FIRST_SEED, FIRST_SEED + episodes):
        environment.random_state.seed(seed)
        policy = policies.find("expert")(environment, np.random.default_rng(seed))
        timestep, count = environment.reset(), 0
        while not timestep.last():
            timestep, count = environment.step(policy(timestep)), count + 1
        if environment.task.episode_metrics["success"]:
            steps.append(count)
    return {"successes": len(steps), "steps": statistics.median(steps) if steps else None}


def main() -> None:
    """Plays the cases that have no row yet, and writes their rows."""
    rows = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else []
    known = {(row["robot"], row["task"], row["mode"], row["episodes"]) for row in rows}
    for case in tqdm([case for case in cases() if case not in known], disable=None):
        robot, task, mode, episodes = case
        rows.append({"robot": robot, "task": task, "mode": mode, "episodes": episodes, **play(*case)})
        RESULTS.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()

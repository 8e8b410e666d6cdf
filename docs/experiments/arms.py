"""Measures the successes of the scripted expert with other arms in the kitchen.

`python docs/experiments/arms.py` plays 20 episodes of each of the seven tasks in `ee_delta_pose` and 5 in the other
control modes of the end effector, and 2 of each further task in `ee_delta_pose`, with the arms that are tested, one
after the other; it goes on where it was stopped. Rows are in results/arms.json, of which `python
docs/scripts/tables.py` makes the tables of docs/guide/arms.md. It needs the extras `experts` and `arms`, and gym-hil.
"""

import statistics

from experiment import RESULTS, Row, make_parser, measure_missing, play

from kitchen_suite import suite
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

ROBOTS = ("panda", "ur5e")
# Numbers of episodes by mode.
EPISODES = {"ee_delta_pose": 20, "ee_pose": 5, "ee_delta_position": 5}
# Mode and number of episodes of a further task.
FURTHER_MODE = "ee_delta_pose"
FURTHER_EPISODES = 2
# Seeds that were not used for tuning.
FIRST_SEED = 30_000


def cases() -> list[Row]:
    """Returns robot, task, mode and number of episodes of each row, in order."""
    seven = [(robot, task, mode, n) for mode, n in EPISODES.items() for robot in ROBOTS for task in DEFAULT_TASKS]
    others = [task for task in GOALS if task not in DEFAULT_TASKS]
    further = [(robot, task, FURTHER_MODE, FURTHER_EPISODES) for robot in ROBOTS for task in others]
    return [dict(zip(("robot", "task", "mode", "episodes"), case, strict=True)) for case in seven + further]


def measure(case: Row) -> Row:
    """Plays the episodes of a case; returns the number of successes, and the median of their control steps."""
    arguments = {"visuals": False, "robot": case["robot"], "control_mode": case["mode"]}
    environment = suite.load("kitchen", case["task"].replace(" ", "_"), arguments)
    played = [play(environment, "expert", FIRST_SEED + i) for i in range(case["episodes"])]
    steps = [steps for success, steps in played if success]
    return {"successes": len(steps), "steps": statistics.median(steps) if steps else None}


if __name__ == "__main__":
    make_parser(__doc__).parse_args()
    measure_missing(RESULTS / "arms.json", cases(), measure)

"""Trains a network on sequences of tasks, and measures it beside the network for one task at a time.

python docs/experiments/sequences.py FOLDER

Episodes of training ask for one to three tasks, each where the one before has ended (`tasks_in_turn`).
`kitchen-evaluate` plays sequences of four and of seven tasks with this policy, `sequences`, and with `seven_in_turn`,
`single`; its JSON is written to results/sequences/. FOLDER keeps the run and the finished episodes: the same command
continues after an interrupt. It needs the extra `train`. `docs/scripts/tables.py` makes a table of the results.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from training import LITTLE_AJAR, ONE_NETWORK

from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.policies.trained import SHIPPED
from kitchen_suite.tasks import DEFAULT_TASKS

RESULTS = Path(__file__).parent / "results" / "sequences"

SINGLE = SHIPPED / "seven_in_turn.npz"
SEED = 1

IN_TURN = {"tasks_in_turn": True}

# Tasks in an episode that is evaluated.
LENGTHS = (4, 7)
EPISODES = 200

# Each object whose task is not asked has been moved to its goal or not, as in later parts of a longer sequence; an
# episode ends where the network is stuck.
EITHER = {"choice": [0.0, 1.0]}
STARTS = {
    "max_episode_steps": 300,
    "max_task_steps": 100,
    "variations": {"tasks/done": [EITHER] * len(DEFAULT_TASKS), **LITTLE_AJAR},
}
TRAINING = (
    "--domain_name=kitchen",
    "--task_name=all",
    f"--task_kwargs={json.dumps({'tasks_per_episode': [1, 3], **IN_TURN})}",
    f"--training_kwargs={json.dumps(STARTS)}",
    f"--hyperparameters={json.dumps(ONE_NETWORK)}",
    "--num_steps=4500000",
    "--eval_interval=250000",
    "--eval_episodes=100",
    # Never reached: the longer it trains, the longer sequences it completes.
    "--target_success=1.1",
)


def train(folder: Path) -> Path:
    """Trains on sequences, or continues; returns the file of the policy."""
    output = folder / "sequences"
    resume = ["--resume"] if (output / "training.json").exists() else []
    call("train", f"--output={output}", f"--seed={SEED}", "--restarts=0", *TRAINING, *resume)
    return output / "policy.npz"


def evaluate(folder: Path, name: str, policy: Path, length: int) -> None:
    """Evaluates a policy in sequences of some length, unless that has been done."""
    written, output = RESULTS / f"{name}_{length}.json", folder / f"{name}_{length}"
    if written.exists():
        return
    resume = ["--resume"] if (output / DESCRIPTION_FILE).exists() else []
    call(
        "evaluate",
        f"--policy=trained(file={str(policy)!r})",
        "--protocol=beso",
        f"--task_name=random_{length}",
        f"--task_kwargs={json.dumps(IN_TURN)}",
        f"--num_episodes={EPISODES}",
        f"--output={output}",
        f"--json={written}",
        *resume,
    )


def call(command: str, *flags: str) -> None:
    """Runs a command of the suite."""
    subprocess.run([sys.executable, "-m", "kitchen_suite", command, *flags], check=True)


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    RESULTS.mkdir(exist_ok=True)
    for length in LENGTHS:
        evaluate(folder, "single", SINGLE, length)
    policy = train(folder)
    for length in LENGTHS:
        evaluate(folder, "sequences", policy, length)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Trains the network for one task at a time on sequences of tasks, and measures it.

python docs/sequence_results.py FOLDER

Training starts from the policy `seven_in_turn`: episodes ask for the seven tasks in an order drawn at each reset, each
where the one before has ended (`tasks_in_turn`). `kitchen-evaluate` plays sequences of four and of seven tasks with the
policy before and after; its JSON is written to docs/benchmarks/sequences/. FOLDER keeps the run and the finished
episodes: the same command continues after an interrupt. It needs the extra `train`. `docs/build.py tables` makes a
table of the results.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.policies.trained import SHIPPED

RESULTS = Path(__file__).parent / "benchmarks" / "sequences"

INITIAL = SHIPPED / "seven_in_turn.npz"
SEED = 1

IN_TURN = '--task_kwargs={"tasks_in_turn": true}'

# Tasks in an episode that is evaluated.
LENGTHS = (4, 7)
EPISODES = 200

# Episodes are as long as those evaluated. Unlike in training from scratch, the network explores less, and learns from
# larger batches, at rates that keep the divergence of an update small: else the policy forgets tasks.
HYPERPARAMETERS = {"num_envs": 128, "rollouts": 64, "hidden": [256, 128], "exploration": 0.3, "averaging": 0.9}
HYPERPARAMETERS |= {"learning_rate": 2e-4, "kl_target": 0.015}
TRAINING = (
    *("--domain_name=kitchen", "--task_name=random_7", IN_TURN, '--training_kwargs={"max_episode_steps": 280}'),
    *(f"--initial_policy={INITIAL}", f"--hyperparameters={json.dumps(HYPERPARAMETERS)}"),
    *("--num_steps=4500000", "--eval_interval=250000", "--eval_episodes=50"),
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
    flags = (f"--policy=trained(file={str(policy)!r})", "--protocol=beso", f"--task_name=random_{length}", IN_TURN)
    call("evaluate", *flags, f"--num_episodes={EPISODES}", f"--output={output}", f"--json={written}", *resume)


def call(command: str, *flags: str) -> None:
    """Runs a command of the suite."""
    subprocess.run([sys.executable, "-m", f"kitchen_suite.cli.{command}", *flags], check=True)


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    RESULTS.mkdir(exist_ok=True)
    for length in LENGTHS:
        evaluate(folder, "before", INITIAL, length)
    policy = train(folder)
    for length in LENGTHS:
        evaluate(folder, "after", policy, length)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Trains networks on sequences of tasks, and measures them beside the network for one task at a time.

python docs/experiments/sequences.py FOLDER

Episodes of training ask for several tasks, each where the one before has ended (`tasks_in_turn`). There are three
approaches: `exact`, one to three tasks in the exact physics; `fast`, one to seven in fast physics; and `continued`,
the same, from the network for one task at a time, `single`. `kitchen-evaluate` plays sequences of four and of seven
tasks with each policy; its JSON is written to results/sequences/, and what is there is skipped. FOLDER keeps runs and
finished episodes: the same command continues after an interrupt. It needs the extra `train`. `docs/scripts/tables.py`
makes a table of the results.
"""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from training import LITTLE_AJAR, ONE_NETWORK

from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.policies.files import SHIPPED
from kitchen_suite.tasks import DEFAULT_TASKS

RESULTS = Path(__file__).parent / "results" / "sequences"

SINGLE = SHIPPED / "seven_in_turn.npz"
SEED = 1

IN_TURN = {"tasks_in_turn": True}

# Tasks in an episode that is evaluated.
LENGTHS = (4, 7)
EPISODES = 200

# Each object whose task is not asked has been moved to its goal or not, as in later parts of a longer sequence.
EITHER = {"choice": [0.0, 1.0]}
VARIATIONS = {"tasks/done": [EITHER] * len(DEFAULT_TASKS), **LITTLE_AJAR}
LONG = {"max_episode_steps": 560, "max_task_steps": 80, "variations": VARIATIONS}


class Approach(NamedTuple):
    """A way to train a network on sequences.

    Attributes:
      tasks: least and greatest number of tasks that an episode asks for.
      training_kwargs: of its environments; an episode ends where the network is stuck.
      exploration: initial standard deviation of the actions.
      num_steps: control steps.
      eval_interval: control steps from one evaluation to the next.
      policy: file of the policy that it starts from; None for training from scratch.
    """

    tasks: tuple[int, int]
    training_kwargs: Mapping[str, Any]
    exploration: float
    num_steps: int
    eval_interval: int
    policy: Path | None = None

    @property
    def flags(self) -> list[str]:
        """Flags of `kitchen-train`."""
        return [
            *("--domain_name=kitchen", "--task_name=all"),
            f"--task_kwargs={json.dumps({'tasks_per_episode': self.tasks, **IN_TURN})}",
            f"--training_kwargs={json.dumps(self.training_kwargs)}",
            f"--hyperparameters={json.dumps({**ONE_NETWORK, 'exploration': self.exploration})}",
            f"--num_steps={self.num_steps}",
            *(f"--eval_interval={self.eval_interval}", "--eval_episodes=100"),
            # Never reached: the longer it trains, the longer sequences it completes.
            "--target_success=1.1",
            *([] if self.policy is None else [f"--initial_policy={self.policy}"]),
        ]


EXACT = {"max_episode_steps": 300, "max_task_steps": 100, "physics": "exact", "variations": VARIATIONS}
APPROACHES = {
    "exact": Approach((1, 3), EXACT, 0.5, 4_500_000, 250_000),
    "fast": Approach((1, 7), LONG, 0.5, 3_500_000, 500_000),
    "continued": Approach((1, 7), LONG, 0.3, 5_500_000, 500_000, SINGLE),
}


def train(folder: Path, name: str) -> Path:
    """Trains on sequences, or continues; returns the file of the policy."""
    output = folder / name
    resume = ["--resume"] if (output / "training.json").exists() else []
    call("train", f"--output={output}", f"--seed={SEED}", "--restarts=0", *APPROACHES[name].flags, *resume)
    return output / "policy.npz"


def evaluate(folder: Path, name: str, policy: Path, length: int) -> None:
    """Evaluates a policy in sequences of some length, or continues."""
    output = folder / f"{name}_{length}"
    resume = ["--resume"] if (output / DESCRIPTION_FILE).exists() else []
    call(
        "evaluate",
        f"--policy=trained(file={str(policy)!r})",
        "--protocol=random-4",
        f"--task_name=random_{length}",
        f"--task_kwargs={json.dumps(IN_TURN)}",
        f"--num_episodes={EPISODES}",
        f"--output={output}",
        f"--json={RESULTS / f'{name}_{length}.json'}",
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
    for name in ("single", *APPROACHES):
        missing = [length for length in LENGTHS if not (RESULTS / f"{name}_{length}.json").exists()]
        policy = SINGLE if name == "single" else train(folder, name) if missing else None
        for length in missing:
            evaluate(folder, name, policy, length)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

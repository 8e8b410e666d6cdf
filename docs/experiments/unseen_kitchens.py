"""Trains the policy for kitchens that it has never seen, which comes with the package.

python docs/experiments/unseen_kitchens.py FOLDER record   demonstrations of the expert
python docs/experiments/unseen_kitchens.py FOLDER train    what is missing of them, and the policy
python docs/experiments/unseen_kitchens.py FOLDER ship     copies the policy to the package

It is cloned from the expert's demonstrations in kitchens of the split `train`. FOLDER keeps recordings and the run: the
same command continues after an interrupt. Its evaluation in kitchens of the split `test` is on the board, see
docs/results/board.md. It needs the extras `experts` and `train`.
"""

import contextlib
import functools
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiment import in_processes, make_parser, run_command
from tqdm import tqdm

import kitchen_suite
from kitchen_suite.episodes.record import DivergedEpisodesError
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies.files import SHIPPED

NAME = "kitchens_open"

# What is learned, and by whom it is demonstrated: as in the kitchen's sets for imitation.
TASK = "open"
EXPERT = "expert(action_noise=0.1, jitter=0.01)"

# Kitchens of the split `train`, in which the expert is certified, and episodes in each.
KITCHENS = 150
EPISODES = 12

# Steps of the optimiser.
STEPS = 15_000


def arguments(design: int) -> dict[str, Any]:
    """Returns the arguments of environments of a kitchen of the split `train`.

    A policy that sees all of a kitchen learns by heart what was done in which; where the hand has to go depends on the
    handle alone, joint velocities on the posture as well.
    """
    return {"design": design, "split": "train", "certified": True, "num_slots": 1, "control_mode": "ee_delta_pose"}


def record_kitchen(folder: Path, design: int) -> Path:
    """Records the demonstrations in a kitchen, or what is missing of them; returns their folder."""
    output = folder / "demonstrations" / f"kitchen_{design}"
    if not (output / "complete").exists():
        spec = EnvironmentSpec.make("kitchens", TASK, arguments(design))
        # Where a few episodes diverge, the others are kept.
        with contextlib.suppress(DivergedEpisodesError):
            kitchen_suite.record(output, spec, EXPERT, num_episodes=EPISODES, seed=100 * design, num_threads=1)
        (output / "complete").touch()
    return output


def record(folder: Path) -> list[Path]:
    """Records the demonstrations in all kitchens; returns their folders."""
    recorded = in_processes(functools.partial(record_kitchen, folder), range(KITCHENS))
    return [*tqdm(recorded, total=KITCHENS, unit="kitchen", disable=None)]


def train(folder: Path) -> None:
    """Trains the policy, and records what is missing of the demonstrations."""
    recordings = record(folder)
    output = folder / "policy"
    run_command(
        "train",
        f"--output={output}",
        *("--domain_name=kitchens", f"--task_name={TASK}", f"--task_kwargs={json.dumps(arguments(0))}"),
        *("--algorithm=bc", "--seed=1", "--restarts=0", "--eval_episodes=10"),
        *(f"--num_steps={STEPS}", f"--eval_interval={STEPS}"),
        f"--demonstrations={','.join(map(str, recordings))}",
        *(["--resume"] if (output / "training.json").exists() else []),
    )


def main(command_line: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("action", choices=("record", "train", "ship"))
    given = parser.parse_args(command_line)
    if given.action == "record":
        record(given.folder)
    elif given.action == "train":
        train(given.folder)
    else:
        shutil.copyfile(given.folder / "policy" / "policy.npz", SHIPPED / f"{NAME}.npz")


if __name__ == "__main__":
    main()

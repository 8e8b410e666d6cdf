"""Trains the policies for kitchens that they have never seen, which come with the package.

python docs/experiments/unseen_kitchens.py FOLDER record   demonstrations of the expert
python docs/experiments/unseen_kitchens.py FOLDER train    what is missing of them, and the policy
python docs/experiments/unseen_kitchens.py FOLDER ship     copies the policy to the package

The policy opens parts of kitchens; with --domain=pick_and_place, another one puts objects away. It is cloned from the
expert's demonstrations in kitchens of the split `train`. FOLDER keeps recordings and the run: the same command
continues after an interrupt. The evaluation of the first in kitchens of the split `test` is on the board, see
docs/results/board.md. It needs the extras `experts` and `train`.
"""

import contextlib
import functools
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiment import in_processes, make_parser, run_command
from tqdm import tqdm

import kitchen_suite
from kitchen_suite.episodes.record import DivergedEpisodesError
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies.files import SHIPPED

EXPERT = "expert(action_noise=0.1, jitter=0.01)"  # As in the kitchen's sets for imitation.


class Kind(NamedTuple):
    """A policy, and the demonstrations that it is cloned from.

    Attributes:
      name: of the policy's file in the package.
      task: that is learned.
      arguments: of the environments, beside the design.
      kitchens: number of kitchens of the split `train`.
      episodes: in each of them, by task; those in which the expert fails are left out.
      steps: of the optimiser.
    """

    name: str
    task: str
    arguments: Mapping[str, Any]
    kitchens: int
    episodes: Mapping[str, int]
    steps: int


# A policy that sees all of a kitchen learns by heart what was done in which; where the hand has to go depends on the
# handle or the object alone, joint velocities on the posture as well.
KINDS = {
    "kitchens": Kind(
        "kitchens_open",
        "open",
        {"certified": True, "num_slots": 1, "control_mode": "ee_delta_pose"},
        kitchens=150,
        episodes={"open": 12},
        steps=15_000,
    ),
    "pick_and_place": Kind(
        "pick_and_place_put_on_put_in_take_out_open_and_put_in",
        "any",
        {"num_slots": 2, "control_mode": "ee_delta_pose"},
        kitchens=100,
        # Most of them ask for what is done most often, and needs no part to be opened.
        episodes={"any": 6, "put_on": 10},
        steps=15_000,
    ),
}


def arguments(domain: str, design: int) -> dict[str, Any]:
    """Returns the arguments of environments of a kitchen of the split `train`."""
    return {"design": design, "split": "train", **KINDS[domain].arguments}


def record_kitchen(folder: Path, domain: str, task_and_design: tuple[str, int]) -> Path:
    """Records the demonstrations of a task in a kitchen, or what is missing of them; returns their folder."""
    task, design = task_and_design
    output = folder / "demonstrations" / f"{task}_{design}"
    if not (output / "complete").exists():
        spec = EnvironmentSpec.make(domain, task, arguments(domain, design))
        count = KINDS[domain].episodes[task]
        # Where a few episodes diverge, the others are kept.
        with contextlib.suppress(DivergedEpisodesError):
            kitchen_suite.record(output, spec, EXPERT, num_episodes=count, seed=100 * design, num_threads=1)
        (output / "complete").touch()
    return output


def record(folder: Path, domain: str) -> list[Path]:
    """Records the demonstrations in all kitchens; returns the folders of those in which the expert succeeded."""
    kind = KINDS[domain]
    wanted = [(task, design) for task in kind.episodes for design in range(kind.kitchens)]
    recorded = in_processes(functools.partial(record_kitchen, folder, domain), wanted)
    outputs = [*tqdm(recorded, total=len(wanted), unit="recording", disable=None)]
    return [output for output in outputs if Recording.open(output).successful]


def train(folder: Path, domain: str) -> None:
    """Trains the policy, and records what is missing of the demonstrations."""
    recordings, kind = record(folder, domain), KINDS[domain]
    output = folder / "policy"
    run_command(
        "train",
        f"--output={output}",
        *(f"--domain_name={domain}", f"--task_name={kind.task}"),
        f"--task_kwargs={json.dumps(arguments(domain, 0))}",
        *("--algorithm=bc", "--seed=1", "--restarts=0", "--eval_episodes=10"),
        *(f"--num_steps={kind.steps}", f"--eval_interval={kind.steps}"),
        f"--demonstrations={','.join(map(str, recordings))}",
        *(["--resume"] if (output / "training.json").exists() else []),
    )


def main(command_line: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("action", choices=("record", "train", "ship"))
    parser.add_argument("--domain", choices=KINDS, default="kitchens", help="whose tasks are learned")
    given = parser.parse_args(command_line)
    if given.action == "record":
        record(given.folder, given.domain)
    elif given.action == "train":
        train(given.folder, given.domain)
    else:
        shutil.copyfile(given.folder / "policy" / "policy.npz", SHIPPED / f"{KINDS[given.domain].name}.npz")


if __name__ == "__main__":
    main()

"""Trains and evaluates the baselines of the page on imitation.

python docs/experiments/imitation.py FOLDER                 all that have no result yet
python docs/experiments/imitation.py FOLDER bc:fixed_order:19:1   some of them: algorithm, set, demonstrations, seed
python docs/experiments/imitation.py FOLDER digests         records the sets, and writes their digests
python docs/experiments/imitation.py FOLDER shift           evaluates under `shift` what `bc` learned from most
                                                        goal_conditioned demonstrations

A cell is a training on the first demonstrations of a set, recorded by `kitchen-record --preset`, and an evaluation of
its policy, whose JSON is written to results/imitation/: `bc` is trained by `kitchen-train`, `flow` by the baseline
docs/baselines/flow.py. Cells with such a file are skipped. FOLDER keeps recordings, runs of `bc` and finished episodes:
the same command continues after an interrupt. It needs the extras `experts` and `train`. `docs/scripts/tables.py` makes
the tables.
"""

import json
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.versions import installed_versions

RESULTS = Path(__file__).parent / "results" / "imitation"
BASELINES = Path(__file__).parent.parent / "baselines"
DIGESTS = Path(__file__).parent / "results" / "demonstrations.json"

# Sets, with the episodes that are recorded, of which more than the greatest count succeed, and the task whose episodes
# are evaluated: the tasks of the set; all seven; four of the seven, which are shown.
SETS = {"fixed_order": (600, "complete"), "random_order": (820, "all"), "goal_conditioned": (1650, "random_4")}
VARIATIONS = "start"

ALGORITHMS = ("bc", "flow")
COUNTS = (19, 100, 566)

# Of every training: small networks, which train within ten minutes on one core.
SIZES = {"width": 256, "batch_size": 256}
STEPS = 12_000
# Further flags of `kitchen-train`: one evaluation at the end.
TRAINING = (f"--eval_interval={STEPS}", "--eval_episodes=10")

EPISODES = 100

# Seeds that neither recordings nor training use.
FIRST_SEED = 400_000_000


class Cell(NamedTuple):
    """A training and its evaluation.

    Attributes:
      algorithm: `bc` or `flow`.
      preset: set of demonstrations.
      count: number of demonstrations.
      seed: of the training.
    """

    algorithm: str
    preset: str
    count: int
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return "_".join(map(str, self))

    @property
    def result(self) -> Path:
        """Path of its JSON."""
        return RESULTS / f"{self.name}.json"


CELLS = (
    *(Cell(algorithm, preset, count, 1) for preset in SETS for count in COUNTS for algorithm in ALGORITHMS),
    *(Cell(algorithm, "random_order", COUNTS[-1], seed) for seed in (2, 3) for algorithm in ALGORITHMS),
)


def call(command: str, *flags: str) -> str:
    """Runs a command of the suite; returns its output."""
    arguments = [sys.executable, "-m", "kitchen_suite", command, *flags]
    return subprocess.run(arguments, check=True, stdout=subprocess.PIPE, text=True).stdout


def set_folder(folder: Path, preset: str, variations: str = VARIATIONS) -> Path:
    """Returns the folder of a set; it has a file `complete` once the set has been recorded."""
    return folder / f"{preset}_{variations or 'original'}"


def record(output: Path, preset: str, variations: str = VARIATIONS) -> str:
    """Records a set, or completes it; returns its digest."""
    varied = [f"--variations={variations}"] if variations else []
    count, _ = SETS[preset]
    printed = call("record", f"--output={output}", f"--preset={preset}", f"--num_episodes={count}", *varied)
    (output / "complete").touch()
    return printed.split()[-1]


def write_digests(folder: Path) -> None:
    """Writes the digests of all sets, with the start varied and as it is in the original, and what they depend on."""
    rows = []
    for preset, (count, _) in SETS.items():
        for variations in (VARIATIONS, ""):
            digest = record(set_folder(folder, preset, variations), preset, variations)
            rows.append({"preset": preset, "variations": variations, "episodes": count, "digest": digest})
    result = {"versions": installed_versions(), "machine": platform.machine(), "sets": rows}
    DIGESTS.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def run_baseline(name: str, recording: Path, output: Path, *flags: str) -> tuple[dict[str, Any], float]:
    """Trains and evaluates a baseline; returns its scores, and the minutes of a processor that training took."""
    if output.exists():
        # What an interrupted run has left.
        shutil.rmtree(output)
    command = [sys.executable, str(BASELINES / f"{name}.py"), str(recording), f"--output={output}", *flags]
    subprocess.run(command, check=True)
    scores, training = (
        json.loads((output / f"{part}.json").read_text(encoding="utf-8")) for part in ("evaluation", "training")
    )
    return scores, training["processor_minutes"]


def recorded(folder: Path, preset: str) -> Path:
    """Returns the folder of a set, which is recorded if it is not complete."""
    output = set_folder(folder, preset)
    if not (output / "complete").exists():
        record(output, preset)
    return output


def train(folder: Path, cell: Cell) -> tuple[Path, float]:
    """Trains a cell of `bc`, or continues; returns the file of the policy, and the minutes."""
    from kitchen_suite.training.run import load_checkpoint

    demonstrations, output, (_, task) = recorded(folder, cell.preset), folder / cell.name, SETS[cell.preset]
    run = [
        f"--output={output}",
        *("--domain_name=kitchen", f"--task_name={task}", f"--variations={VARIATIONS}"),
        *(f"--algorithm={cell.algorithm}", f"--demonstrations={demonstrations}", f"--num_demonstrations={cell.count}"),
        *(f"--seed={cell.seed}", "--restarts=0", "--num_threads=1", f"--num_steps={STEPS}"),
        f"--hyperparameters={json.dumps(SIZES)}",
    ]
    call("train", *run, *TRAINING, *(["--resume"] if (output / "training.json").exists() else []))
    last = load_checkpoint(output / f"seed_{cell.seed}")
    assert last
    return output / "policy.npz", last["processor_seconds"] / 60


def measure(folder: Path, cell: Cell) -> None:
    """Trains and evaluates a cell, and writes its JSON."""
    scores, minutes = measure_flow(folder, cell) if cell.algorithm == "flow" else measure_bc(folder, cell)
    result: dict[str, Any] = {**cell._asdict(), "minutes": minutes, **scores}
    RESULTS.mkdir(exist_ok=True)
    cell.result.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def measure_bc(folder: Path, cell: Cell) -> tuple[dict[str, Any], float]:
    """Trains and evaluates a cell of `bc`; returns its scores, and the minutes."""
    policy, minutes = train(folder, cell)
    _, task = SETS[cell.preset]
    written = folder / f"{cell.name}.json"
    episodes = (f"--variations={VARIATIONS}", f"--seed={FIRST_SEED}", f"--num_episodes={EPISODES}")
    evaluate(folder, cell.name, policy, written, "--protocol=default", f"--task_name={task}", *episodes)
    return json.loads(written.read_text(encoding="utf-8")), minutes


def measure_flow(folder: Path, cell: Cell) -> tuple[dict[str, Any], float]:
    """Trains and evaluates a cell of `flow`; returns its scores, and the minutes."""
    _, task = SETS[cell.preset]
    flags = (
        *(f"--num_demonstrations={cell.count}", f"--seed={cell.seed}", f"--num_steps={STEPS}"),
        *(f"--{name}={value}" for name, value in SIZES.items()),
        *(f"--task_name={task}", f"--task_kwargs={json.dumps({'variations': [VARIATIONS]})}"),
        *(f"--eval_seed={FIRST_SEED}", f"--eval_episodes={EPISODES}"),
    )
    return run_baseline("flow", recorded(folder, cell.preset), folder / cell.name, *flags)


def evaluate(folder: Path, name: str, policy: Path, written: Path, *flags: str) -> None:
    """Evaluates a policy, or continues, with some flags of `kitchen-evaluate`; writes its JSON."""
    output = folder / f"{name}_episodes"
    resume = ["--resume"] if (output / DESCRIPTION_FILE).exists() else []
    own = (f"--policy=trained(file={str(policy)!r})", "--num_threads=1", f"--output={output}", f"--json={written}")
    call("evaluate", *flags, *own, *resume)


def evaluate_shift(folder: Path) -> None:
    """Evaluates what `bc` learned from most goal_conditioned demonstrations under the protocol `shift`."""
    cell = Cell("bc", "goal_conditioned", COUNTS[-1], 1)
    written = RESULTS.with_name("evaluation") / "bc_shift.json"
    if not written.exists():
        policy, _ = train(folder, cell)
        evaluate(folder, f"{cell.name}_shift", policy, written, "--protocol=shift")


def cells_of(cells: Sequence[Any], names: Sequence[str]) -> list[Any]:
    """Returns the cells that arguments name; all without arguments.

    Raises:
      ValueError: an argument names none.
    """
    by_name = {":".join(map(str, cell)): cell for cell in cells}
    if unknown := [name for name in names if name not in by_name]:
        raise ValueError(f"{unknown[0]!r} is none of {', '.join(by_name)}")
    return [by_name[name] for name in names or by_name]


def run(
    arguments: Sequence[str],
    usage: str | None,
    cells: Sequence[Any],
    measure: Callable[[Path, Any], None],
    others: Mapping[str, Callable[[Path], None]],
) -> int:
    """Runs the command of an experiment; returns the exit status.

    Args:
      arguments: of the command line: a folder, and names of cells or one of `others`.
      usage: printed where they are missing.
      cells: named tuples with the path of a `result`.
      measure: measures a cell that has no result yet.
      others: what the command does instead, by name.
    """
    try:
        folder, names = Path(arguments[0]), arguments[1:]
        work = others.get(" ".join(names))
        chosen = [] if work else cells_of(cells, names)
    except (IndexError, ValueError) as error:
        print(error if arguments else usage, file=sys.stderr)
        return 2
    if work:
        work(folder)
    for cell in chosen:
        if not cell.result.exists():
            measure(folder, cell)
    return 0


# What the command does instead of training and evaluating cells.
OTHERS = {"digests": write_digests, "shift": evaluate_shift}


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    return run(arguments, __doc__, CELLS, measure, OTHERS)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Records the sets for offline learning, and trains and evaluates the baselines of docs/experiments/offline.md on them.

python docs/experiments/offline.py FOLDER                    all baselines that have no result yet
python docs/experiments/offline.py FOLDER iql:mixed:1        some of them: algorithm, set, seed
python docs/experiments/offline.py FOLDER sets               records the sets, and writes what they hold
python docs/experiments/offline.py FOLDER online             PPO from clones of the sets, in fast physics

A baseline is a run of `kitchen-train` on a set, recorded by `kitchen-record --preset`, and evaluations of its policy
after the last step by `kitchen-evaluate`; its JSON is written to results/offline/. Those with such a file are skipped.
FOLDER keeps recordings, runs and finished episodes: the same command continues after an interrupt. It needs the extras
`experts` and `train`. `docs/scripts/tables.py` makes the tables.
"""

import collections
import hashlib
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from imitation import call, evaluate

from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.versions import installed_versions, machine

RESULTS = Path(__file__).parent / "results" / "offline"
SETS = Path(__file__).parent / "results" / "datasets.json"
ONLINE = Path(__file__).parent / "results" / "offline_online.json"

# What policies from each set are evaluated on: the task, and arguments of its environments.
GOAL = {"goal_states": 1}
TASKS: dict[str, tuple[tuple[str, dict[str, Any]], ...]] = {
    "complete": (("complete", {}),),
    "partial": (("partial", {}),),
    "mixed": (("mixed", {}),),
    "play": (("random_1", GOAL), ("random_4", GOAL)),
    "noisy": (("random_1", GOAL), ("random_4", GOAL)),
}
ALGORITHMS = {
    **dict.fromkeys(("complete", "partial", "mixed"), ("offline_bc", "iql", "td3bc")),
    "play": ("gcbc", "gciql"),
}
SEEDS = (1, 2, 3)

# Steps of the optimiser. Policies are those after the last one: none is chosen by its evaluations.
STEPS = 20_000

EPISODES = 100

# Seeds that neither recordings nor training use.
FIRST_SEED = 400_000_000


class Cell(NamedTuple):
    """A training and its evaluations.

    Attributes:
      algorithm: value of `--algorithm`.
      preset: set of demonstrations.
      seed: of the training.
    """

    algorithm: str
    preset: str
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return "_".join(map(str, self))

    @property
    def result(self) -> Path:
        """Path of its JSON."""
        return RESULTS / f"{self.name}.json"


CELLS = [
    Cell(algorithm, preset, seed)
    for preset, algorithms in ALGORITHMS.items()
    for seed in SEEDS
    for algorithm in algorithms
]


def record(folder: Path, preset: str) -> tuple[Path, float]:
    """Records a set, or completes it; returns its folder, and the minutes that this took."""
    output, started = folder / preset, time.monotonic()
    call("record", f"--output={output}", f"--preset={preset}")
    return output, (time.monotonic() - started) / 60


def describe(output: Path, preset: str, minutes: float) -> dict[str, Any]:
    """Returns what a set holds."""
    recording = RecordingFolder.open(output)
    stats = [recording.load_stats(index) for index in recording.indices]
    counts = collections.Counter(len(each.metrics["tasks_completed"]) for each in stats)
    return {
        "preset": preset,
        "task": recording.spec.task_name,
        "policy": recording.spec.policy,
        "episodes": len(stats),
        "steps": sum(each.steps for each in stats),
        "successes": sum(bool(each.metrics["success"]) for each in stats),
        "tasks_completed": {str(count): counts[count] for count in sorted(counts)},
        "megabytes": round(sum(path.stat().st_size for path in output.glob("*.npz")) / 1e6, 1),
        "minutes": round(minutes, 1),
        "digest": recording.digest(recording.indices),
    }


def write_sets(folder: Path) -> None:
    """Records all sets, and writes what they hold, and what their digests depend on; sets that are there are kept."""
    found = json.loads(SETS.read_text("utf-8"))["sets"] if SETS.exists() else []
    rows = {row["preset"]: row for row in found}
    for preset in TASKS:
        if preset not in rows:
            rows[preset] = describe(*_recorded(folder, preset))
            result = {"versions": installed_versions(), "machine": machine(), "sets": [*rows.values()]}
            SETS.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def _recorded(folder: Path, preset: str) -> tuple[Path, str, float]:
    output, minutes = record(folder, preset)
    return output, preset, minutes


def train(folder: Path, cell: Cell) -> tuple[Path, float]:
    """Trains a policy, or continues; returns its file, and the minutes of a processor."""
    from kitchen_suite.training import checkpoints
    from kitchen_suite.training.seed_run import LAST_POLICY_FILE

    demonstrations, _ = record(folder, cell.preset)
    output, (task, arguments) = folder / cell.name, TASKS[cell.preset][0]
    run = (
        f"--output={output}",
        *(f"--task_name={task}", f"--task_kwargs={json.dumps(arguments)}", "--num_threads=1"),
        *(f"--algorithm={cell.algorithm}", f"--demonstrations={demonstrations}", f"--seed={cell.seed}"),
        *(f"--num_steps={STEPS}", f"--eval_interval={STEPS}", "--eval_episodes=1"),
        *(["--resume"] if (output / "training.json").exists() else []),
    )
    call("train", *run)
    last = checkpoints.load_last(output / f"seed_{cell.seed}")
    assert last
    return output / f"seed_{cell.seed}" / LAST_POLICY_FILE, last.processor_seconds / 60


def measure(folder: Path, cell: Cell) -> None:
    """Trains and evaluates a policy, and writes its JSON."""
    policy, minutes = train(folder, cell)
    conditions = {}
    for task, arguments in TASKS[cell.preset]:
        name = f"{cell.name}_{task}"
        written, receipt = folder / f"{name}.json", folder / f"{name}.npz"
        given = (f"--task_name={task}", f"--task_kwargs={json.dumps(arguments)}", f"--receipt={receipt}")
        episodes = (f"--seed={FIRST_SEED}", f"--num_episodes={EPISODES}")
        evaluate(folder, name, policy, written, "--protocol=default", *given, *episodes)
        conditions[task] = {**json.loads(written.read_text("utf-8")), "digest": digest_of(receipt)}
    result = {**cell._asdict(), "minutes": minutes, "machine": machine(), "conditions": conditions}
    RESULTS.mkdir(exist_ok=True)
    cell.result.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def digest_of(receipt: Path) -> str:
    """Returns the SHA-256 of the digests of all episodes of a receipt."""
    with np.load(receipt) as arrays:
        digests = [arrays[name].tobytes() for name in sorted(arrays.files) if name.endswith("/digests")]
    return hashlib.sha256(b"".join(digests)).hexdigest()


def cells_of(names: Sequence[str]) -> list[Cell]:
    """Returns the cells that arguments name; all without arguments.

    Raises:
      ValueError: an argument names none.
    """
    cells = {":".join(map(str, cell)): cell for cell in CELLS}
    if unknown := [name for name in names if name not in cells]:
        raise ValueError(f"{unknown[0]!r} is none of {', '.join(cells)}")
    return [cells[name] for name in names or cells]

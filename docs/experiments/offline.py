"""Records the sets for offline learning, and trains and evaluates the baselines of docs/experiments/offline.md on them.

python docs/experiments/offline.py FOLDER                    all baselines that have no result yet
python docs/experiments/offline.py FOLDER iql:mixed:1        some of them: algorithm, set, seed
python docs/experiments/offline.py FOLDER sets               records the sets, and writes what they hold
python docs/experiments/offline.py FOLDER online             PPO from clones of the sets, in fast physics

A baseline is a run of docs/baselines/iql.py on a set, recorded by `kitchen-record --preset`: `iql` extracts the policy
by weights, `idql` by flow matching. Its scores are written to results/offline/; those with such a file are skipped.
FOLDER keeps recordings, runs and receipts: the same command continues after an interrupt, and `kitchen-replay` checks
the receipts. It needs the extras `experts` and `train`. `docs/scripts/tables.py` makes the tables.
"""

import collections
import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from imitation import call, evaluate, run, run_baseline

from kitchen_suite.episodes.recording import Recording
from kitchen_suite.versions import installed_versions, machine

RESULTS = Path(__file__).parent / "results" / "offline"
SETS = Path(__file__).parent / "results" / "datasets.json"
ONLINE = Path(__file__).parent / "results" / "offline_online.json"

# Variations of the start, of recordings and evaluations: without them all episodes of a policy are nearly the same one.
VARIATIONS = "start"

# What is recorded for the digests: sets, with varied starts or not.
RECORDED = (
    *((preset, variations) for preset in ("complete", "partial", "mixed") for variations in ("", VARIATIONS)),
    *((preset, VARIATIONS) for preset in ("play", "noisy")),
)

# Sets that baselines learn from; policies are evaluated on the task of the same name.
PRESETS = ("mixed", "partial", "complete")
# Flags of the baseline by algorithm.
ALGORITHMS = {"iql": "--extraction=weights", "idql": "--extraction=flow"}
SEEDS = (1, 2, 3)

# Steps of the optimiser. Policies are those after the last one: none is chosen by its evaluations.
STEPS = 40_000

EPISODES = 100

# Seeds that neither recordings nor training use.
FIRST_SEED = 400_000_000

# From offline to online: the set that is cloned, and control steps of PPO in fast physics after it, in small updates.
ONLINE_SET, ONLINE_STEPS = "mixed", 1_000_000
SMALL_UPDATES = {
    **{"num_envs": 64, "rollouts": 128, "mini_batches": 8, "learning_rate": 5e-6, "kl_target": 0.01},
    **{"exploration": 0.05, "value_batches": 10, "discount": 0.99},
}


class Cell(NamedTuple):
    """A training and its evaluations.

    Attributes:
      algorithm: `iql` or `idql`; `ppo` from a clone.
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


CELLS = [Cell(algorithm, preset, seed) for preset in PRESETS for seed in SEEDS for algorithm in ALGORITHMS]


def record(folder: Path, preset: str, variations: str = VARIATIONS) -> Path:
    """Records a set, or completes it; returns its folder."""
    output = folder / f"{preset}_{variations or 'original'}"
    varied = [f"--variations={variations}"] if variations else []
    call("record", f"--output={output}", f"--preset={preset}", *varied)
    return output


def describe(folder: Path, preset: str, variations: str) -> dict[str, Any]:
    """Records a set, and returns what it holds."""
    output = record(folder, preset, variations)
    recording = Recording.open(output)
    stats = [recording.load_summary(index) for index in recording.indices]
    counts = collections.Counter(len(each.metrics["tasks_completed"]) for each in stats)
    return {
        "preset": preset,
        "variations": variations,
        "task": recording.spec.task_name,
        "episodes": len(stats),
        "steps": sum(each.steps for each in stats),
        "successes": sum(bool(each.metrics["success"]) for each in stats),
        "tasks_completed": {str(count): counts[count] for count in sorted(counts)},
        "megabytes": round(sum(path.stat().st_size for path in output.glob("*.npz")) / 1e6, 1),
        # That its episodes took, beside each other and whatever interrupted them.
        "minutes": round(sum(each.seconds for each in stats) / 60, 1),
        "digest": recording.digest(recording.indices),
    }


def write_sets(folder: Path) -> None:
    """Records all sets, and writes what they hold, and what their digests depend on; sets with a row are kept."""
    rows = json.loads(SETS.read_text("utf-8"))["sets"] if SETS.exists() else []
    for preset, variations in RECORDED:
        if (preset, variations) not in {(row["preset"], row["variations"]) for row in rows}:
            rows.append(describe(folder, preset, variations))
            result = {"versions": installed_versions(), "machine": machine(), "sets": rows}
            SETS.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def train(folder: Path, cell: Cell, name: str, *flags: str) -> tuple[Path, float]:
    """Trains a policy by PPO with some flags, or continues; returns its file, and the minutes of a processor."""
    from kitchen_suite.training.run import LAST_POLICY_FILE, load_checkpoint

    demonstrations = record(folder, cell.preset)
    output = folder / name
    own = (
        f"--output={output}",
        *(f"--task_name={cell.preset}", f"--variations={VARIATIONS}"),
        *(f"--algorithm={cell.algorithm}", f"--demonstrations={demonstrations}", f"--seed={cell.seed}"),
        *("--num_threads=1", "--restarts=0", "--eval_episodes=10"),
        *(["--resume"] if (output / "training.json").exists() else []),
    )
    call("train", *own, *flags)
    last = load_checkpoint(output / f"seed_{cell.seed}")
    assert last
    return output / f"seed_{cell.seed}" / LAST_POLICY_FILE, last["processor_seconds"] / 60


def score(folder: Path, name: str, policy: Path, task: str) -> dict[str, Any]:
    """Evaluates a policy on a task; returns its JSON, with the digest of the episodes."""
    name = f"{name}_{task}"
    written, receipt = folder / f"{name}.json", folder / f"{name}_receipt.npz"
    given = (f"--task_name={task}", f"--variations={VARIATIONS}")
    episodes = (f"--seed={FIRST_SEED}", f"--num_episodes={EPISODES}", f"--receipt={receipt}")
    evaluate(folder, name, policy, written, "--protocol=default", *given, *episodes)
    return with_digest(json.loads(written.read_text("utf-8")), receipt)


def with_digest(scores: dict[str, Any], receipt: Path) -> dict[str, Any]:
    """Returns the scores of an evaluation with the digest of its episodes, from its receipt."""
    # There is one condition, whose numbers are those of the whole.
    return {**{key: value for key, value in scores.items() if key != "conditions"}, "digest": digest_of(receipt)}


def measure(folder: Path, cell: Cell) -> None:
    """Trains and evaluates a policy, and writes its JSON."""
    output = folder / cell.name
    flags = (
        *(ALGORITHMS[cell.algorithm], f"--num_steps={STEPS}", f"--seed={cell.seed}"),
        *(f"--eval_seed={FIRST_SEED}", f"--eval_episodes={EPISODES}"),
    )
    scores, minutes = run_baseline("iql", record(folder, cell.preset), output, *flags)
    conditions = {cell.preset: with_digest(scores, output / "receipt.npz")}
    result = {**cell._asdict(), "minutes": minutes, "machine": machine(), "conditions": conditions}
    RESULTS.mkdir(exist_ok=True)
    cell.result.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def write_online(folder: Path) -> None:
    """Evaluates clones of a set, and what PPO makes of them in fast physics; seeds with a row are kept."""
    rows = json.loads(ONLINE.read_text("utf-8")) if ONLINE.exists() else []
    for seed in SEEDS:
        if seed in {row["seed"] for row in rows}:
            continue
        cell, row = Cell("ppo", ONLINE_SET, seed), {"seed": seed}
        for stage, steps in (("clone", 0), ("online", ONLINE_STEPS)):
            name = f"{cell.name}_{stage}"
            flags = (f"--num_steps={steps}", f"--eval_interval={max(steps, 1)}", "--target_success=1.1", "--patience=0")
            fast = ('--training_kwargs={"physics": "fast"}', f"--hyperparameters={json.dumps(SMALL_UPDATES)}")
            policy, minutes = train(folder, cell, name, *flags, *fast)
            row[stage] = {"steps": steps, "minutes": minutes, **score(folder, name, policy, ONLINE_SET)}
        rows.append(row)
        ONLINE.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def digest_of(receipt: Path) -> str:
    """Returns the SHA-256 of the digests of all episodes of a receipt."""
    with np.load(receipt) as arrays:
        digests = [arrays[name].tobytes() for name in sorted(arrays.files) if name.endswith("/digests")]
    return hashlib.sha256(b"".join(digests)).hexdigest()


# What the command does instead of training and evaluating cells.
OTHERS = {"sets": write_sets, "online": write_online}


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    return run(arguments, __doc__, CELLS, measure, OTHERS)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

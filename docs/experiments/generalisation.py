"""Success in kitchens that a policy has never seen, by the number of kitchens that it was trained in.

python docs/experiments/generalisation.py FOLDER        networks trained in 1, 10 and 100 kitchens, and their scores
python docs/experiments/generalisation.py FOLDER 10     some of them: the number of kitchens
python docs/experiments/generalisation.py FOLDER curve  the picture of the curve

All networks learn from the same number of demonstrations of the scripted expert, in the first kitchens of the split
`train`, by the same number of optimiser's steps. They are evaluated in the first kitchens of the split `test`, on parts
that their certificates list. FOLDER keeps recordings, runs and evaluations: the same command continues after an
interrupt. Results are written to results/kitchens_curve.json. It needs the extras `experts` and `train`.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from imitation import call

from kitchen_suite import policies
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.results import wilson
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.versions import machine

RESULTS = Path(__file__).parent / "results" / "kitchens_curve.json"
PICTURE = Path(__file__).resolve().parent.parent / "pictures" / "kitchens_curve.svg"

COUNTS = (1, 10, 100)

# Successful demonstrations of every training; optimiser's steps; test kitchens, and episodes in each.
DEMONSTRATIONS, STEPS, TEST_KITCHENS, EPISODES = 2_000, 20_000, 100, 4

# What is learned, and by whom it is demonstrated: as in the kitchen's sets for imitation.
TASK, EXPERT = "open", "expert(action_noise=0.1, jitter=0.01)"

# Seed of the training, and the first one of the test episodes.
SEED, FIRST_SEED = 1, 400_000_000


def arguments(design: int, split: str = "train") -> dict[str, Any]:
    """Returns the arguments of environments of a kitchen.

    A policy that sees all of a kitchen learns by heart what was done in which; where the hand has to go depends on the
    handle alone, joint velocities on the posture as well.
    """
    return {"design": design, "split": split, "certified": True, "num_slots": 1, "control_mode": "ee_delta_pose"}


def flags(design: int) -> list[str]:
    """Returns the flags that name a task in a kitchen."""
    return ["--domain_name=kitchens", f"--task_name={TASK}", f"--task_kwargs={json.dumps(arguments(design))}"]


def outcomes(output: Path) -> list[bool]:
    """Returns which episodes of a recording succeeded; empty if there is none."""
    if not output.exists():
        return []
    recording = RecordingFolder.open(output)
    return [bool(recording.load_stats(i).metrics["success"]) for i in recording.indices]


def record(folder: Path, design: int, count: int) -> Path:
    """Records episodes in a kitchen until a number of them succeed; returns their folder."""
    output = folder / f"kitchen_{design}"
    recorded = outcomes(output)
    while sum(recorded) < count:
        # Nearly all succeed.
        episodes = len(recorded) + count - sum(recorded) + 2
        call("record", f"--output={output}", f"--policy={EXPERT}", f"--num_episodes={episodes}", *flags(design))
        recorded = outcomes(output)
    return output


def train(folder: Path, count: int) -> Path:
    """Trains a network in some kitchens, or continues; returns the file of its policy."""
    each = DEMONSTRATIONS // count
    recordings = [record(folder, design, each) for design in range(count)]
    output = folder / f"run_{count}"
    call(
        "train",
        *(f"--output={output}", "--algorithm=flow", f"--demonstrations={','.join(map(str, recordings))}"),
        *(f"--num_demonstrations={each}", f"--seed={SEED}", "--restarts=0", "--eval_episodes=10"),
        *(f"--num_steps={STEPS}", f"--eval_interval={STEPS}"),
        *(["--resume"] if (output / "training.json").exists() else []),
        *flags(0),
    )
    return output / "policy.npz"


def play(policy: Path, design: int, split: str) -> list[bool]:
    """Plays episodes in a kitchen; returns which of them succeed."""
    spec = EnvironmentSpec.make(domain_name="kitchens", task_name=TASK, task_kwargs=arguments(design, split))
    with spec.make_environment() as environment:
        inner = suite_env(environment).environment
        act = policies.find(f"trained(file={str(policy)!r})")(inner, np.random.default_rng(SEED))
        results = []
        for episode in range(EPISODES):
            inner.random_state.seed((FIRST_SEED + 1_000 * design + episode) % 2**32)
            timestep, steps = inner.reset(), 0
            while not timestep.last() and steps < spec.max_episode_steps:
                timestep, steps = inner.step(act(timestep)), steps + 1
            results.append(bool(inner.task.episode_metrics["success"]))
        return results


def measure(folder: Path, count: int) -> dict[str, Any]:
    """Trains a network and scores it in kitchens that it has not seen, and in those that it has; at most as many."""
    policy = train(folder, count)
    row: dict[str, Any] = {"kitchens": count, "demonstrations": DEMONSTRATIONS, "steps": STEPS, "machine": machine()}
    for name, split, designs in (("unseen", "test", TEST_KITCHENS), ("seen", "train", min(count, TEST_KITCHENS))):
        played = [success for design in range(designs) for success in play(policy, design, split)]
        low, high = wilson(sum(played), len(played))
        row[name] = {"episodes": len(played), "success": float(np.mean(played)), "interval": [low, high]}
    return row


def draw(rows: Sequence[dict[str, Any]]) -> None:
    """Writes the picture of the curve."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5, 3.2), layout="constrained")
    for name, label in (("seen", "kitchens of the training"), ("unseen", f"{TEST_KITCHENS} kitchens never seen")):
        counts = [row["kitchens"] for row in rows]
        success = np.array([row[name]["success"] for row in rows])
        errors = np.abs(np.array([row[name]["interval"] for row in rows]).T - success)
        axes.errorbar(counts, success, errors, marker="o", capsize=3, label=label)
    axes.set(xscale="log", xlabel="kitchens trained in", ylabel="success", ylim=(0, 1.03))
    axes.set_xticks(counts, counts)
    axes.minorticks_off()
    axes.legend()
    figure.savefig(PICTURE)


def main(given: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    if not given:
        print(__doc__, file=sys.stderr)
        return 2
    rows = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else []
    if given[1:] == ["curve"]:
        draw(rows)
        return 0
    for count in map(int, given[1:] or map(str, COUNTS)):
        if count not in {row["kitchens"] for row in rows}:
            rows = sorted([*rows, measure(Path(given[0]), count)], key=lambda row: row["kitchens"])
            RESULTS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Success in kitchens that a policy has never seen, by the number of kitchens that it was trained in.

python docs/experiments/generalisation.py FOLDER        networks trained in 1, 10 and 100 kitchens, and their scores
python docs/experiments/generalisation.py FOLDER 10     some of them: the number of kitchens
python docs/experiments/generalisation.py FOLDER curve  the picture of the curve

All networks learn by flow matching (docs/baselines/flow.py) from the same number of demonstrations of the scripted
expert, in the first kitchens of the split `train`, by the same number of optimiser's steps. They are evaluated in the
first kitchens of the split `test`, on parts that their certificates list. FOLDER keeps recordings: the same command
continues after an interrupt with the numbers of kitchens that have no result yet. Results are written to
results/kitchens_curve.json. It needs the extras `experts` and `train`.
"""

import dataclasses
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import flow
import numpy as np
from experiment import PICTURES, RESULTS, Row, make_parser, positive, read_rows, run_command, timesteps, write_rows

from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.scores import wilson
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies.networks import ResidualNetwork, Scales
from kitchen_suite.training.demonstrations import load_demonstrations
from kitchen_suite.versions import machine

ROWS = RESULTS / "kitchens_curve.json"
PICTURE = PICTURES / "kitchens_curve.svg"

COUNTS = (1, 10, 100)

# Of every training: successful demonstrations, and the optimiser's steps.
DEMONSTRATIONS = 2_000
STEPS = 20_000

# Test kitchens, and episodes in each.
TEST_KITCHENS = 100
EPISODES = 4

# What is learned, and by whom it is demonstrated: as in the kitchen's sets for imitation.
TASK = "open"
EXPERT = "expert(action_noise=0.1, jitter=0.01)"

# Seed of the training, and the first one of the test episodes.
SEED = 1
FIRST_SEED = 400_000_000


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
    recording = Recording.open(output)
    return [bool(recording.load_summary(i).metrics["success"]) for i in recording.indices]


def record(folder: Path, design: int, count: int) -> Path:
    """Records episodes in a kitchen until a number of them succeed; returns their folder."""
    output = folder / f"kitchen_{design}"
    recorded = outcomes(output)
    while sum(recorded) < count:
        # Nearly all succeed.
        episodes = len(recorded) + count - sum(recorded) + 2
        run_command("record", f"--output={output}", f"--policy={EXPERT}", f"--num_episodes={episodes}", *flags(design))
        recorded = outcomes(output)
    return output


@dataclasses.dataclass(frozen=True)
class Network:
    """A trained network, and the standardisation of its inputs and actions."""

    network: ResidualNetwork
    scales: Scales


def train(folder: Path, count: int) -> Network:
    """Trains a network in some kitchens."""
    each = DEMONSTRATIONS // count
    recordings = [record(folder, design, each) for design in range(count)]
    demonstrations = load_demonstrations(recordings, EnvironmentSpec.make("kitchens", TASK, arguments(0)), (), [each])
    return Network(*flow.train(demonstrations, flow.Config(), num_steps=STEPS, seed=SEED))


def play(trained: Network, design: int, split: str) -> list[bool]:
    """Plays episodes in a kitchen; returns which of them succeed."""
    spec = EnvironmentSpec.make(domain_name="kitchens", task_name=TASK, task_kwargs=arguments(design, split))
    with spec.make_environment() as environment:
        inner = suite_env(environment).environment
        # One generator draws the noise of all episodes in a kitchen.
        generators = itertools.repeat(np.random.default_rng(SEED))
        act = flow.FlowPolicy(trained.network, trained.scales, inner.task.policy_inputs, flow.Config(), generators)
        results = []
        for episode in range(EPISODES):
            inner.random_state.seed((FIRST_SEED + 1_000 * design + episode) % 2**32)
            for _ in itertools.islice(timesteps(inner, act), spec.max_episode_steps + 1):
                pass
            results.append(bool(inner.task.episode_metrics["success"]))
        return results


def measure(folder: Path, count: int) -> Row:
    """Trains a network and scores it in kitchens that it has not seen, and in those that it has; at most as many."""
    trained = train(folder, count)
    row: Row = {"kitchens": count, "demonstrations": DEMONSTRATIONS, "steps": STEPS, "machine": machine()}
    for name, split, designs in (("unseen", "test", TEST_KITCHENS), ("seen", "train", min(count, TEST_KITCHENS))):
        played = [success for design in range(designs) for success in play(trained, design, split)]
        low, high = wilson(sum(played), len(played))
        row[name] = {"episodes": len(played), "success": float(np.mean(played)), "interval": [low, high]}
    return row


def draw(rows: Sequence[Row]) -> None:
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("kitchens", nargs="*", help="numbers of kitchens, or curve")
    given = parser.parse_args(arguments)
    if given.kitchens == ["curve"]:
        draw(read_rows(ROWS))
        return
    for count in map(positive, given.kitchens) if given.kitchens else COUNTS:
        rows = read_rows(ROWS)
        if count not in {row["kitchens"] for row in rows}:
            write_rows(ROWS, sorted([*rows, measure(given.folder, count)], key=lambda row: row["kitchens"]))


if __name__ == "__main__":
    main()

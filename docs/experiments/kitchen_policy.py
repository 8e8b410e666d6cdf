"""Trains and measures the policy of the whole kitchen that comes with the package.

python docs/experiments/kitchen_policy.py FOLDER record     demonstrations of the expert
python docs/experiments/kitchen_policy.py FOLDER train      what is missing, then a policy in rounds of corrections
python docs/experiments/kitchen_policy.py FOLDER evaluate   the last policy, or --policy=FILE, in all conditions
python docs/experiments/kitchen_policy.py FOLDER ship       copies the last policy to the package

The first policy is cloned from the expert's demonstrations. In each round the expert takes over from the last policy
wherever that has led by some control step (`--policy=takeover`), and the next policy is cloned from all recordings so
far. FOLDER keeps recordings, runs and finished episodes: the same command continues after an interrupt. Results are
written to results/kitchen_policy.json. It needs the extras `experts` and `train`.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.policies.trained import SHIPPED

RESULTS = Path(__file__).parent / "results" / "kitchen_policy.json"

# What the expert needs to see where furniture and robot stand elsewhere.
POSES = [
    "franka/base_pose",
    *(f"{prop}/pose" for prop in ("hood", "hinge_cabinet", "microwave", "slide_cabinet")),
]

# On the way to the hinge cabinet's handle the expert's hand brushes against the cabinet, which costs it the grasp in
# fast physics, unless it moves more slowly.
EXPERT = "action_noise=0.1, jitter=0.01, speed=0.9"


class Recording(NamedTuple):
    """A set of episodes that ask for one to seven tasks.

    Attributes:
      physics: `exact` or `fast`.
      variations: groups that vary.
      episodes: their number.
      steps: control steps after which an episode fails.
    """

    physics: str
    variations: str
    episodes: int
    steps: int = 280

    @property
    def name(self) -> str:
        """Name of its folder."""
        return "_".join((self.physics, *(self.variations or "original").split(",")))


DEMONSTRATIONS = (
    Recording("exact", "", 300),
    Recording("exact", "start", 500),
    Recording("exact", "start,push", 300),
    Recording("exact", "start,layout", 800),
    Recording("exact", "start,layout,push", 500),
    Recording("fast", "", 300),
    Recording("fast", "start", 400),
    Recording("fast", "start,layout", 500),
)

# Of each round: where the last policy leads, and the expert goes on.
CORRECTIONS = (
    Recording("exact", "", 150, 560),
    Recording("exact", "start", 200, 560),
    Recording("exact", "start,layout", 500, 560),
    Recording("exact", "start,layout,push", 250, 560),
    Recording("fast", "start,layout", 200, 560),
)
ROUNDS = 2
LATEST = 180

STEPS = 24_000
TRAINING = (f"--num_steps={STEPS}", f"--eval_interval={STEPS}", "--eval_episodes=50", "--restarts=0")

# Recordings have their own first seeds, and evaluations seeds that no recording and no training uses.
ROUND_SEEDS = 1_000_000
FIRST_SEED, EPISODES = 400_000_000, 200

# Conditions by name: task, and arguments of the environment.
CONDITIONS: dict[str, tuple[str, dict[str, Any]]] = {
    "all": ("all", {"variations": []}),
    "all, start": ("all", {"variations": ["start"]}),
    "complete, layout": ("complete", {"variations": ["layout"]}),
    "complete, layout held out": ("complete", {"variations": ["layout"], "variation_split": "held_out"}),
    "random 4": ("random_4", {"variations": ["start"]}),
    "random 4, start held out": ("random_4", {"variations": ["start"], "variation_split": "held_out"}),
    "random 4, push": ("random_4", {"variations": ["push"]}),
    "random 4, undisturbed": ("random_4", {"variations": []}),
    "all, fast": ("all", {"variations": [], "physics": "fast"}),
    "random 4, fast": ("random_4", {"variations": ["start"], "physics": "fast"}),
}


def call(command: str, *flags: str) -> None:
    """Runs a command of the suite."""
    subprocess.run([sys.executable, "-m", "kitchen_suite", command, *flags], check=True)


def environment_kwargs(physics: str) -> dict[str, Any]:
    """Returns the arguments of the environments that are recorded."""
    kwargs: dict[str, Any] = {"tasks_per_episode": [1, 7], "extra_observables": POSES}
    return kwargs if physics == "exact" else {**kwargs, "physics": physics}


def record(folder: Path, recording: Recording, policy: str, seed: int) -> Path:
    """Records a set, or completes it; returns its folder, which has a file `complete` from then on."""
    output = folder / recording.name
    if not (output / "complete").exists():
        varied = [f"--variations={recording.variations}"] if recording.variations else []
        call(
            "record",
            f"--output={output}",
            *("--domain_name=kitchen", "--task_name=all"),
            f"--task_kwargs={json.dumps(environment_kwargs(recording.physics))}",
            *(f"--policy={policy}", f"--seed={seed}", f"--num_episodes={recording.episodes}"),
            f"--max_episode_steps={recording.steps}",
            *varied,
        )
        (output / "complete").touch()
    return output


def demonstrations(folder: Path) -> list[Path]:
    """Records the expert's demonstrations, or what is missing of them; returns their folders."""
    seeds = range(0, ROUND_SEEDS, ROUND_SEEDS // 100)
    return [
        record(folder / "demonstrations", each, f"expert({EXPERT})", seed)
        for each, seed in zip(DEMONSTRATIONS, seeds, strict=False)
    ]


def corrections(folder: Path, number: int) -> list[Path]:
    """Records the corrections of a round, or what is missing of them; returns their folders."""
    policy = f"file={str(run_folder(folder, number - 1) / 'policy.npz')!r}, latest={LATEST}"
    seeds = range(number * ROUND_SEEDS, (number + 1) * ROUND_SEEDS, ROUND_SEEDS // 100)
    return [
        record(folder / f"corrections_{number}", each, f"takeover({policy}, {EXPERT})", seed)
        for each, seed in zip(CORRECTIONS, seeds, strict=False)
    ]


def run_folder(folder: Path, number: int) -> Path:
    """Returns the folder of the training of a round; round 0 has the demonstrations alone."""
    return folder / f"policy_{number}"


def train(folder: Path) -> None:
    """Trains the policies of all rounds, and records what they learn from; continues where it was interrupted."""
    recordings = demonstrations(folder)
    for number in range(ROUNDS + 1):
        output = run_folder(folder, number)
        if number:
            recordings += corrections(folder, number)
        if (output / "complete").exists():
            continue
        call(
            "train",
            f"--output={output}",
            *("--domain_name=kitchen", "--task_name=all", "--variations=start", "--algorithm=bc", "--seed=1"),
            f"--task_kwargs={json.dumps(environment_kwargs('exact'))}",
            f"--demonstrations={','.join(map(str, recordings))}",
            *TRAINING,
            *(["--resume"] if (output / "training.json").exists() else []),
        )
        (output / "complete").touch()


def last_policy(folder: Path) -> Path:
    """Returns the file of the policy of the last round that has been trained."""
    runs = [run_folder(folder, number) for number in range(ROUNDS + 1)]
    return next(run / "policy.npz" for run in reversed(runs) if (run / "complete").exists())


def evaluate(folder: Path, policy: Path) -> None:
    """Evaluates a policy in all conditions, and writes their scores."""
    results = {}
    for name, (task, kwargs) in CONDITIONS.items():
        episodes = folder / "episodes" / policy.parent.name / name.replace(", ", "_").replace(" ", "_")
        written = episodes.with_suffix(".json")
        if not written.exists():
            episodes.parent.mkdir(parents=True, exist_ok=True)
            call(
                "evaluate",
                f"--policy=trained(file={str(policy)!r})",
                *("--protocol=default", f"--task_name={task}", f"--task_kwargs={json.dumps(kwargs)}"),
                *(f"--seed={FIRST_SEED}", f"--num_episodes={EPISODES}", "--max_episode_steps=280"),
                *(f"--output={episodes}", f"--json={written}"),
                *(["--resume"] if (episodes / DESCRIPTION_FILE).exists() else []),
            )
        results[name] = json.loads(written.read_text(encoding="utf-8"))
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def ship(folder: Path) -> None:
    """Copies the last policy to the package."""
    shutil.copyfile(last_policy(folder), SHIPPED / "kitchen.npz")


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    match arguments:
        case [folder, "record"]:
            demonstrations(Path(folder))
        case [folder, "train"]:
            train(Path(folder))
        case [folder, "evaluate"]:
            evaluate(Path(folder), last_policy(Path(folder)))
        case [folder, "evaluate", option] if option.startswith("--policy="):
            evaluate(Path(folder), Path(option.removeprefix("--policy=")))
        case [folder, "ship"]:
            ship(Path(folder))
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Trains and measures policies of the whole kitchen, of which `kitchen` and `pixels` come with the package.

python docs/experiments/kitchen_policy.py kitchen FOLDER record     demonstrations of the expert
python docs/experiments/kitchen_policy.py kitchen FOLDER train      what is missing, then a policy in each round
python docs/experiments/kitchen_policy.py kitchen FOLDER evaluate   the last policy, or --policy=FILE, in all conditions
python docs/experiments/kitchen_policy.py kitchen FOLDER ship       copies the last policy to the package
python docs/experiments/kitchen_policy.py kitchen_strict FOLDER ... the same for strict success
python docs/experiments/kitchen_policy.py pixels FOLDER ...         the same from pictures of two cameras

The first policy is cloned from the expert's demonstrations. In each later round the expert takes over from the last
policy wherever that has led by some control step (`--policy=takeover`), and the next policy is cloned from all
recordings so far. FOLDER keeps recordings, runs and finished episodes: the same command continues after an interrupt.
Results are written to results/kitchen_policy.json. It needs the extras `experts` and `train`.
"""

import itertools
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities.props import BURNER_DISPLACEMENTS
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.files import SHIPPED
from kitchen_suite.tasks import DEFAULT_TASKS
from kitchen_suite.tasks.kitchen.variations import DONE
from kitchen_suite.tasks.variations.distributions import Bands, Choice

RESULTS = Path(__file__).parent / "results" / "kitchen_policy.json"

TASKS_PER_EPISODE: int | list[int] = [1, 7]

# What the expert needs to see where furniture and robot stand elsewhere.
POSES = [
    "franka/base_pose",
    *(f"{prop}/pose" for prop in ("hood", "hinge_cabinet", "microwave", "slide_cabinet")),
]

# Arguments of the environments by what policies are for: the threshold, strict success, or pictures instead of objects.
KINDS: dict[str, dict[str, Any]] = {
    "original": {"extra_observables": POSES},
    "strict": {"extra_observables": POSES, "success": "strict"},
    "pixels": {
        "obs_type": "pixels_agent_pos",
        "cameras": ["workspace", "franka/hand"],
        "image_size": [64, 64],
        "render_quality": "fast",
    },
}

# On the way to the hinge cabinet's handle the expert's hand brushes against the cabinet, which costs it the grasp in
# fast physics, unless it moves more slowly.
EXPERT = "action_noise=0.1, jitter=0.01, speed=0.9"
# Of strict success the expert shows more than is asked, since what learns from it stops a little short.
EXPERTS = {"kitchen": EXPERT, "kitchen_strict": f"{EXPERT}, done=0.6", "pixels": EXPERT}


class Recording(NamedTuple):
    """A set of episodes that ask for one to seven tasks.

    Attributes:
      physics: `exact` or `fast`.
      variations: groups that vary; or one of `RINGS`, see `ring_variations`.
      episodes: their number.
      steps: control steps after which an episode fails.
      kind: one of `KINDS`.
    """

    physics: str
    variations: str
    episodes: int
    steps: int = 280
    kind: str = "original"

    @property
    def name(self) -> str:
        """Name of its folder."""
        return "_".join((self.physics, *(self.variations or "original").split(",")))

    @property
    def environment_kwargs(self) -> dict[str, Any]:
        """Arguments of the environments."""
        return {
            "tasks_per_episode": TASKS_PER_EPISODE,
            **KINDS[self.kind],
            **({} if self.physics == "exact" else {"physics": self.physics}),
        }


# Distances of the kettle from the burner on which it stands in held-out layouts [m]. It is never on that burner, where
# it would be evaluated.
RINGS = {"hob": (0.06, 0.15), "burner": (0.025, 0.1)}
# Its greatest turn there [rad], and the number of its places.
TURN, PLACES = 0.2, 400


def ring_variations(name: str) -> dict[str, Any]:
    """Returns the seen starts and layouts with the kettle around another burner, and with more tasks done."""
    task = suite.load("kitchen", "all", {"visuals": False, "variations": ["start", "layout"]}).task
    seen = {name: described(row.seen) for name, row in task.variations.by_name.items() if name != DONE}
    generator = np.random.default_rng(0)
    ends = (RINGS[name], (0.0, 2 * np.pi), (-TURN, TURN))
    distances, angles, turns = (generator.uniform(*each, PLACES) for each in ends)
    x, y = BURNER_DISPLACEMENTS[2, :2]
    places = np.stack([x + distances * np.cos(angles), y + distances * np.sin(angles), turns], axis=1)
    chosen = places[(places[:, :2] < 0.5).all(axis=1)].round(3)
    half = [{"choice": [0.0, 1.0]}] * len(DEFAULT_TASKS)
    return {**seen, "kettle/burner": 0.0, "kettle/pose": {"choice": chosen.tolist()}, DONE: half}


def described(distribution: Bands | Choice) -> dict[str, Any]:
    """Returns a distribution of a group with one interval, or with choices, as JSON describes it."""
    if isinstance(distribution, Choice):
        return {"choice": distribution.values.tolist()}
    (interval,) = distribution.intervals
    return {"uniform": interval.tolist()}


DEMONSTRATIONS = (
    Recording("exact", "", 300),
    Recording("exact", "start", 500),
    Recording("exact", "start,push", 300),
    Recording("exact", "start,layout", 800),
    Recording("exact", "start,layout,push", 500),
    Recording("exact", "hob", 700),
    Recording("fast", "", 300),
    Recording("fast", "start", 400),
    Recording("fast", "start,layout", 500),
)

# Where the last policy leads, and the expert goes on.
CORRECTIONS = (
    Recording("exact", "", 150, 560),
    Recording("exact", "start", 200, 560),
    Recording("exact", "start,layout", 500, 560),
    Recording("exact", "start,layout,push", 250, 560),
    Recording("exact", "hob", 300, 560),
    Recording("fast", "start,layout", 200, 560),
)
LATEST = 180

# Recordings by policy and by round; the first round has demonstrations alone.
ROUNDS: dict[str, tuple[tuple[Recording, ...], ...]] = {
    "kitchen": (DEMONSTRATIONS, CORRECTIONS, (*CORRECTIONS, Recording("exact", "burner", 900, 560))),
    "kitchen_strict": (
        (Recording("exact", "start", 500, 560, "strict"),),
        (Recording("exact", "start", 400, 800, "strict"),),
    ),
    "pixels": (
        (
            Recording("exact", "", 200, kind="pixels"),
            Recording("exact", "start", 550, kind="pixels"),
            Recording("exact", "start,appearance,camera", 450, kind="pixels"),
        ),
        (
            Recording("exact", "start", 200, 560, "pixels"),
            Recording("exact", "start,appearance,camera", 150, 560, "pixels"),
        ),
    ),
}

# Sets that are recorded side by side, and threads of each.
PROCESSES, THREADS = 2, 1

# Steps of the optimiser in each round, and further flags of training.
STEPS = {"kitchen": (24_000,) * 3, "kitchen_strict": (8_000, 16_000), "pixels": (7_000, 18_000)}
TRAINING = {
    "kitchen": (),
    "kitchen_strict": (),
    "pixels": ('--hyperparameters={"batch_size": 128}', "--eval_episodes=20"),
}

# Recordings have their own first seeds, and evaluations seeds that no recording and no training uses.
ROUND_SEEDS = 1_000_000
FIRST_SEED, EPISODES = 400_000_000, 200

# Actions that are timed.
ACTIONS = 500

# Conditions by policy and name: task, control steps, and arguments of the environment.
CONDITIONS: dict[str, dict[str, tuple[str, int, dict[str, Any]]]] = {
    "kitchen": {
        "all": ("all", 280, {"variations": []}),
        "all, start": ("all", 280, {"variations": ["start"]}),
        "complete, layout": ("complete", 280, {"variations": ["layout"]}),
        "complete, layout held out": ("complete", 280, {"variations": ["layout"], "variation_split": "held_out"}),
        "random 4": ("random_4", 280, {"variations": ["start"]}),
        "random 4, start held out": ("random_4", 280, {"variations": ["start"], "variation_split": "held_out"}),
        "random 4, push": ("random_4", 280, {"variations": ["push"]}),
        "random 4, undisturbed": ("random_4", 280, {"variations": []}),
        "all, fast": ("all", 280, {"variations": [], "physics": "fast"}),
        "random 4, fast": ("random_4", 280, {"variations": ["start"], "physics": "fast"}),
        "complete, layout, fast": ("complete", 280, {"variations": ["layout"], "physics": "fast"}),
    },
    "kitchen_strict": {"random 4": ("random_4", 400, {"variations": ["start"], "success": "strict"})},
    "pixels": {
        name: (task, 280, {"variations": variations.split(","), "variation_split": split, **KINDS["pixels"]})
        for name, task, variations, split in (
            ("complete", "complete", "start", "seen"),
            ("random 4", "random_4", "start", "seen"),
            ("random 4, appearance", "random_4", "start,appearance", "seen"),
            ("random 4, appearance held out", "random_4", "start,appearance", "held_out"),
            ("random 4, camera", "random_4", "start,camera", "seen"),
            ("random 4, camera held out", "random_4", "start,camera", "held_out"),
        )
    },
}


def call(command: str, *flags: str) -> None:
    """Runs a command of the suite."""
    subprocess.run([sys.executable, "-m", "kitchen_suite", command, *flags], check=True)


def record(folder: Path, recording: Recording, policy: str, seed: int) -> Path:
    """Records a set, or completes it; returns its folder, which has a file `complete` from then on."""
    output = folder / recording.name
    if not (output / "complete").exists():
        ring = recording.variations in RINGS
        variations = json.dumps(ring_variations(recording.variations)) if ring else recording.variations
        call(
            "record",
            f"--output={output}",
            *("--domain_name=kitchen", "--task_name=all"),
            f"--task_kwargs={json.dumps(recording.environment_kwargs)}",
            *(f"--policy={policy}", f"--seed={seed}", f"--num_episodes={recording.episodes}"),
            *(f"--max_episode_steps={recording.steps}", f"--num_threads={THREADS}"),
            *([f"--variations={variations}"] if variations else []),
        )
        (output / "complete").touch()
    return output


def record_round(name: str, folder: Path, number: int) -> list[Path]:
    """Records the sets of a round side by side, or what is missing of them; returns their folders."""
    policy, output = f"expert({EXPERTS[name]})", folder / "demonstrations"
    if number:
        file = run_folder(folder, number - 1) / "policy.npz"
        policy = f"takeover(file={str(file)!r}, latest={LATEST}, {EXPERTS[name]})"
        output = folder / f"corrections_{number}"
    seeds = itertools.count(number * ROUND_SEEDS, ROUND_SEEDS // 100)
    with ThreadPoolExecutor(PROCESSES) as pool:
        return [*pool.map(lambda each, seed: record(output, each, policy, seed), ROUNDS[name][number], seeds)]


def run_folder(folder: Path, number: int) -> Path:
    """Returns the folder of the training of a round."""
    return folder / f"policy_{number}"


def train(name: str, folder: Path) -> None:
    """Trains the policies of all rounds, and records what they learn from; continues where it was interrupted."""
    recordings: list[Path] = []
    for number, ((first, *_), steps) in enumerate(zip(ROUNDS[name], STEPS[name], strict=True)):
        recordings += record_round(name, folder, number)
        output = run_folder(folder, number)
        if (output / "complete").exists():
            continue
        call(
            "train",
            f"--output={output}",
            *("--domain_name=kitchen", "--task_name=all", "--variations=start", "--algorithm=bc", "--seed=1"),
            f"--task_kwargs={json.dumps(first.environment_kwargs)}",
            f"--demonstrations={','.join(map(str, recordings))}",
            *(f"--num_steps={steps}", f"--eval_interval={steps}", "--eval_episodes=50", "--restarts=0"),
            *TRAINING[name],
            *(["--resume"] if (output / "training.json").exists() else []),
        )
        (output / "complete").touch()


def last_policy(name: str, folder: Path) -> Path:
    """Returns the file of the policy of the last round that has been trained."""
    runs = [run_folder(folder, number) for number in range(len(ROUNDS[name]))]
    return next(run / "policy.npz" for run in reversed(runs) if (run / "complete").exists())


def evaluate(name: str, folder: Path, policy: Path) -> None:
    """Evaluates a policy in all conditions, and writes its scores and speed beside those of the other policies."""
    results = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    scores: dict[str, Any] = {}
    results[name] = {"action_milliseconds": action_milliseconds(policy), "conditions": scores}
    for condition, (task, steps, kwargs) in CONDITIONS[name].items():
        episodes = folder / "episodes" / policy.parent.name / condition.replace(", ", "_").replace(" ", "_")
        written = episodes.with_suffix(".json")
        if not written.exists():
            episodes.parent.mkdir(parents=True, exist_ok=True)
            call(
                "evaluate",
                f"--policy=trained(file={str(policy)!r})",
                *("--protocol=default", f"--task_name={task}", f"--task_kwargs={json.dumps(kwargs)}"),
                *(f"--seed={FIRST_SEED}", f"--num_episodes={EPISODES}", f"--max_episode_steps={steps}"),
                *(f"--output={episodes}", f"--json={written}"),
                *(["--resume"] if (episodes / DESCRIPTION_FILE).exists() else []),
            )
        scores[condition] = json.loads(written.read_text(encoding="utf-8"))
        RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def action_milliseconds(path: Path) -> float:
    """Returns the processor time of an action of a policy in numpy."""
    policy = load_policy(path)
    inputs = np.zeros(policy.scales.input_mean.size)
    pictures = [np.zeros((*policy.metadata["image_size"], 3), np.uint8) for _ in policy.given.cameras]
    started = time.process_time()
    for _ in range(ACTIONS):
        policy.predict(inputs, pictures)
    return round(1000 * (time.process_time() - started) / ACTIONS, 3)


def ship(name: str, folder: Path) -> None:
    """Copies the last policy to the package."""
    shutil.copyfile(last_policy(name, folder), SHIPPED / f"{name}.npz")


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    match arguments:
        case [name, folder, "record"] if name in ROUNDS:
            record_round(name, Path(folder), 0)
        case [name, folder, "train"] if name in ROUNDS:
            train(name, Path(folder))
        case [name, folder, "evaluate"] if name in ROUNDS:
            evaluate(name, Path(folder), last_policy(name, Path(folder)))
        case [name, folder, "evaluate", option] if name in ROUNDS and option.startswith("--policy="):
            evaluate(name, Path(folder), Path(option.removeprefix("--policy=")))
        case [name, folder, "ship"] if name in ROUNDS:
            ship(name, Path(folder))
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

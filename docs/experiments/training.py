"""Trains the tasks of the page on training, one seed after the other, and measures the policies.

python docs/experiments/training.py FOLDER drawer             the drawer, five seeds
python docs/experiments/training.py FOLDER earlier            the drawer with earlier hyperparameters, one seed
python docs/experiments/training.py FOLDER kitchen            the kitchen's seven tasks, three seeds each
python docs/experiments/training.py FOLDER one                one network for the seven tasks, three seeds
python docs/experiments/training.py FOLDER further            the kitchen's further tasks, one seed each
python docs/experiments/training.py FOLDER kettle:1 kettle:2  some tasks with some seeds
python docs/experiments/training.py FOLDER ship               copies the best policy of each kitchen task to the package

Each run has a folder in FOLDER, such as kettle_1, and a row in results/training.json: control steps, minutes, processor
minutes, and the successes of its best policy in 100 episodes of the default environment, on seeds that neither training
nor its evaluations have seen. Runs that have a row are skipped, interrupted ones are resumed. It needs the extra
`train`. `docs/scripts/tables.py` makes the tables.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kitchen_suite import suite
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies.files import SHIPPED
from kitchen_suite.policies.perceptron import PerceptronPolicy
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

RESULTS = Path(__file__).parent / "results" / "training.json"

DRAWER = "top_drawer"
KITCHEN = tuple(task.replace(" ", "_") for task in DEFAULT_TASKS)
FURTHER = tuple(task.replace(" ", "_") for task in GOALS if task not in DEFAULT_TASKS)
LEFT_DOOR = ("left_hinge_cabinet", "close_left_hinge_cabinet")

# Each episode asks for one of the seven.
ONE = "random_1"

# The drawer with earlier hyperparameters, for comparison.
EARLIER = "top_drawer_earlier"

# Groups of runs, and the seeds of each task.
GROUPS = {"drawer": (DRAWER,), "earlier": (EARLIER,), "kitchen": KITCHEN, "one": (ONE,), "further": FURTHER}
SEEDS = {
    DRAWER: range(1, 6),
    **{task: range(1, 4) for task in (*KITCHEN, ONE)},
    **{task: range(1, 2) for task in (EARLIER, *FURTHER)},
}

# Flags of kitchen-train beside task, seed and folder, for the tasks that need any.
ONE_NETWORK = {"num_envs": 128, "hidden": [256, 128], "kl_target": 0.03, "averaging": 0.9, "noise_correlation": 0.85}
ONE_NETWORK |= {"exploration": 0.5}
# Draws beyond the range of a door are doors that are closed.
LITTLE_AJAR = {
    "microwave/door": {"uniform": [-0.38, 0.38]},
    "hinge_cabinet/doors": [0.0, {"uniform": [-0.2, 0.4]}],
}
# The left door starts anywhere between closed and open in half of the episodes.
LEFT_AJAR = [0.0] * 6 + [0.1, 0.2, 0.3, 0.45, 0.6, 0.75]
_EARLIER = {"num_envs": 1024, "learning_epochs": 5, "mini_batches": 8, "hidden": [256, 128, 64], "averaging": 0.0}
_EARLIER |= {"learning_rate": 3e-4, "standardisation_epsilon": 0.05}


def _left_ajar(sign: int) -> str:
    """Returns the flag with which the left door starts between closed and open; `sign` is of its displacement."""
    doors = {"choice": [[sign * angle, 0.0] for angle in LEFT_AJAR]}
    return f"--training_kwargs={json.dumps({'variations': {'hinge_cabinet/doors': doors}})}"


FLAGS: dict[str, tuple[str, ...]] = {
    # About five minutes on two processors; most seeds reach the target before.
    DRAWER: ("--num_steps=4500000",),
    EARLIER: (f"--hyperparameters={json.dumps(_EARLIER)}",),
    # About three minutes on two processors: some of these tasks may not be learned.
    **dict.fromkeys(FURTHER, ("--num_steps=800000",)),
    **{task: ("--num_steps=800000", _left_ajar(sign)) for task, sign in zip(LEFT_DOOR, (-1, 1), strict=True)},
    # About forty minutes.
    ONE: (
        "--num_steps=3300000",
        "--target_success=0.98",
        "--eval_interval=300000",
        "--eval_episodes=280",
        f"--hyperparameters={json.dumps(ONE_NETWORK)}",
        f"--training_kwargs={json.dumps({'variations': LITTLE_AJAR})}",
    ),
}

# Tasks that are asked of a policy, one after the other; those left out have one.
TASKS_ASKED = {ONE: DEFAULT_TASKS}

# Training and its evaluations take their seeds from 500,000,000 on.
UNSEEN, EPISODES = 30_000, 100

Run = tuple[str, int]


def command(run: Run, folder: Path) -> list[str]:
    """Returns the command of a run: a new one, or an interrupted one that goes on."""
    name, seed = run
    output, task = folder / f"{name}_{seed}", DRAWER if name == EARLIER else name
    domain = next(domain for domain, each in suite.ALL_TASKS if each == task)
    arguments = [f"--domain_name={domain}", f"--task_name={task}", f"--output={output}", f"--seed={seed}"]
    resume = ["--resume"] if (output / "training.json").exists() else []
    return [sys.executable, "-m", "kitchen_suite", "train", *arguments, "--restarts=0", *FLAGS.get(name, ()), *resume]


def measure(run: Run, folder: Path) -> dict[str, Any]:
    """Returns the row of a run that has ended."""
    from kitchen_suite.training.run import load_checkpoint

    task, seed = run
    output = folder / f"{task}_{seed}"
    last = load_checkpoint(output / f"seed_{seed}")
    assert last
    return {
        "task": task,
        "seed": seed,
        "steps": last["steps"],
        "minutes": last["seconds"] / 60,
        "processor_minutes": last["processor_seconds"] / 60,
        "processors": len(os.sched_getaffinity(0)),
        "episodes": EPISODES,
        "success": successes(output / "policy.npz", TASKS_ASKED.get(task, ("",))),
    }


def successes(policy_file: Path, asked: Sequence[str]) -> list[int]:
    """Returns the number of episodes in which a policy succeeds, for each task that is asked of it."""
    from kitchen_suite.training.ppo import NetworkController
    from kitchen_suite.training.run import evaluate

    policy = PerceptronPolicy.load(policy_file)
    spec = EnvironmentSpec.make(**{name: policy.metadata[name] for name in ("domain_name", "task_name", "task_kwargs")})
    environments = spec.make_vector_env(EPISODES, None, **spec.env_class.flat_options)
    counts = []
    with contextlib.closing(environments):
        for name in asked:
            if name:
                tasks = environments.composer_task
                tasks.task_weights = {other: float(other == name) for other in DEFAULT_TASKS}
            metrics = evaluate(NetworkController(policy, environments), environments, range(UNSEEN, UNSEEN + EPISODES))
            counts.append(int(metrics["episode/success"].sum()))
    return counts


def read() -> list[dict[str, Any]]:
    """Returns the rows measured so far."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else []


def add(row: dict[str, Any]) -> None:
    """Adds a row to the file of results, in the order of tasks and seeds."""
    order = [(task, seed) for task in SEEDS for seed in SEEDS[task]]
    rows = {(row["task"], row["seed"]): row for row in [*read(), row]}
    ordered = sorted(rows, key=lambda run: order.index(run) if run in order else len(order))
    RESULTS.write_text(json.dumps([rows[run] for run in ordered], indent=1) + "\n", encoding="utf-8")


def ship(folder: Path) -> None:
    """Copies policies of the kitchen to the package: of each task, that of the first seed with the most successes.

    Of one network for several tasks, these are the successes in the task in which it has fewest.
    """
    for task in (*KITCHEN, ONE):
        if rows := [row for row in read() if row["task"] == task]:
            best = max(rows, key=lambda row: (min(row["success"]), sum(row["success"]), -row["seed"]))
            with suite.load("kitchen", task, {"visuals": False}) as environment:
                name = environment.task.policy_inputs.names[0]
            shutil.copyfile(folder / f"{task}_{best['seed']}" / "policy.npz", SHIPPED / f"{name}.npz")


def runs_of(names: Sequence[str]) -> list[Run]:
    """Returns the runs that arguments name: groups, or tasks with seeds.

    Raises:
      ValueError: an argument is neither.
    """
    runs: list[Run] = []
    for name in names:
        task, _, seed = name.partition(":")
        if name in GROUPS:
            runs += [(each, number) for each in GROUPS[name] for number in SEEDS[each]]
        elif task in SEEDS and seed.isdecimal():
            runs.append((task, int(seed)))
        else:
            raise ValueError(f"{name!r} is neither one of {', '.join(GROUPS)} nor a task with a seed, such as kettle:1")
    return runs


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    try:
        folder, names = Path(arguments[0]), arguments[1:]
        runs = [] if names == ["ship"] else runs_of(names)
    except (IndexError, ValueError) as error:
        print(f"{__doc__}\n{error}", file=sys.stderr)
        return 2
    if names == ["ship"]:
        ship(folder)
    measured = {(row["task"], row["seed"]) for row in read()}
    for run in runs:
        if run in measured:
            continue
        if status := subprocess.run(command(run, folder), check=False).returncode:
            return status
        row = measure(run, folder)
        add(row)
        print(json.dumps(row))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Compares what two versions of the suite compute, array by array, to the bit.

python tests/compare_trees.py REVISION           plays every case on that revision of this repository and on this tree
python tests/compare_trees.py REVISION --only=vec    only the cases whose name contains `vec`

Both trees play in processes of their own, on this machine and with the same packages. Only public names are used: those
that stay when modules move. The commands are found in each tree's setup.cfg. The cases of experts, recordings and
training are left out where their extras are not installed. Exit status: 0 if all arrays are equal, else 1.
"""

import argparse
import configparser
import contextlib
import copy
import importlib
import importlib.util
import io
import itertools
import json
import os
import pickle
import pkgutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tree
from tqdm import tqdm

ROOT = Path(__file__).resolve().parent.parent

# Those of the first revision that others are compared with.
TASKS = {
    "kitchen": (
        *("bottom_burner", "top_burner", "light_switch", "slide_cabinet", "hinge_cabinet", "microwave", "kettle"),
        *("complete", "partial", "mixed", "all"),
    ),
    "open_cabinet": ("top_drawer", "bottom_drawer"),
}
KITCHEN, CABINET = "KitchenSuite/FrankaKitchen-v1", "KitchenSuite/FrankaOpenCabinet-v1"
Arrays = dict[str, np.ndarray]
Case = Callable[[], Arrays]


def has(*packages: str) -> bool:
    return all(importlib.util.find_spec(package) for package in packages)


def flat(name: str, nested: Any) -> Arrays:
    """Leaves of nested containers as arrays, by path."""
    paths = tree.flatten_with_path(without_objects(nested))
    return {"/".join(map(str, (name, *path))): np.asarray(leaf) for path, leaf in paths}


def without_objects(nested: Any) -> Any:
    """Nested containers in which arrays of objects, as Gymnasium's infos hold them, are lists."""
    if isinstance(nested, dict):
        return {key: without_objects(part) for key, part in nested.items()}
    if isinstance(nested, np.ndarray) and nested.dtype == object:
        return [without_objects(part) for part in nested.tolist()]
    return nested


def stacked(rows: list[Arrays]) -> Arrays:
    """Rows of a trajectory as one array for each name; those of differing shapes one by one."""
    arrays: Arrays = {}
    for name in dict.fromkeys(itertools.chain(*rows)):
        column = [row[name] for row in rows if name in row]
        if len({(part.shape, part.dtype) for part in column}) == 1:
            arrays[name] = np.stack(column)
        else:
            arrays |= {f"{name}@{step}": row[name] for step, row in enumerate(rows) if name in row}
    return arrays


# suite.load


def play_dm_env(
    domain: str, task: str, policy: str = "random", steps: int = 120, episodes: int = 1, seed: int = 3, **kwargs: Any
) -> Arrays:
    from kitchen_suite import policies, suite

    environment_kwargs = kwargs.pop("environment_kwargs", None)
    environment = suite.load(domain, task, {"random": seed, **kwargs}, environment_kwargs)
    rows = []
    for episode in range(episodes):
        act = policies.find(policy)(environment, np.random.default_rng((seed + episode, 1)))
        timestep = environment.reset()
        while not timestep.last() and len(rows) < (episode + 1) * steps:
            observed = timestep._replace(observation=dict(timestep.observation))
            action = act(timestep)
            state = {"qpos": environment.physics.data.qpos.copy(), "qvel": environment.physics.data.qvel.copy()}
            timestep = environment.step(action)
            rows.append(flat("", {**observed._asdict(), **state, "action": action}))
        rows.append(flat("", timestep._replace(observation=dict(timestep.observation))._asdict()))
    results = json.dumps(getattr(environment.task, "episode_metrics", None) or environment.task.episode_results)
    return {**stacked(rows), "results": np.array(results), "random": environment.random_state.uniform(size=3)}


def dm_env_cases() -> Iterator[tuple[str, Case]]:
    from kitchen_suite.tasks import Randomization

    def case(*args: Any, **kwargs: Any) -> Case:
        return lambda: play_dm_env(*args, **kwargs)

    for domain, task in ((domain, task) for domain, tasks in TASKS.items() for task in tasks):
        for policy in ("random", "zero"):
            yield f"load {domain} {task} {policy}", case(domain, task, policy, steps=60, visuals=False)
        if has("mink", "daqp"):
            yield f"load {domain} {task} expert", case(domain, task, "expert", steps=700, visuals=False)
            noisy = "expert(speed=0.8, jitter=0.005, action_noise=0.002)"
            yield f"load {domain} {task} noisy expert", case(domain, task, noisy, steps=300, visuals=False)
    kitchen: dict[str, dict[str, Any]] = {
        "visuals": {},
        "two episodes": {"episodes": 2, "time_limit": 4.0, "steps": 300},
        "sleep": {"sleep": True, "visuals": False, "steps": 200},
        "true feedback": {"feedback": "true", "visuals": False},
        "target feedback": {"feedback": "target", "visuals": False},
        "fast": {"velocity_scale": 30.0, "visuals": False},
        "own goals": {
            "goals": {"kettle": [0, 1, 2, 1, 0, 0, 0]},
            "threshold": 3.0,
            "terminate_on_tasks_completed": False,
        },
        "staying tasks": {"remove_task_when_completed": False, "threshold": 1.0, "terminate_on_tasks_completed": False},
        "no noise": {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0},
        "much noise": {"robot_noise_ratio": 0.3, "object_noise_ratio": 0.1, "seed": 2**35 + 1},
        "flat": {"environment_kwargs": {"flat_observation": True}},
        "buffered": {"environment_kwargs": {"strip_singleton_obs_buffer_dim": False}},
    }
    for name, kwargs in kitchen.items():
        yield f"load kitchen all, {name}", case("kitchen", "all", **kwargs)
    drawn = Randomization(
        cabinet_yaw=lambda *_, random_state, **__: random_state.uniform(-0.1, 0.1), drawer_friction=2.0
    )
    cabinet: dict[str, dict[str, Any]] = {
        "visuals": {"episodes": 2},
        "deterministic": {"gripper": "deterministic", "policy": "trained", "steps": 700},
        "trained": {"policy": "trained", "steps": 700, "visuals": False},
        "trained grasp": {"policy": "trained", "reward": "grasp", "steps": 700, "visuals": False},
        "noise": {"observation_noise": {"joint_positions": 0.01, "handle_offset": 0.02}, "visuals": False},
        "randomised": {"randomization": drawn, "episodes": 3, "steps": 40},
        "flat": {"environment_kwargs": {"flat_observation": True}},
    }
    for name, kwargs in cabinet.items():
        yield f"load open_cabinet top_drawer, {name}", case("open_cabinet", "top_drawer", **kwargs)


# Gymnasium


def play_gymnasium(env_id: str, *, scale: float = 1.0, steps: int = 60, seed: int = 11, **kwargs: Any) -> Arrays:
    import gymnasium

    environment = gymnasium.make(f"kitchen_suite.gymnasium_env:{env_id}", **kwargs)
    inner, rng = environment.unwrapped, np.random.default_rng(seed)
    observation, info = environment.reset(seed=seed)
    rows = [flat("", {"observation": observation, "info": info})]
    for step in range(steps):
        if step == steps // 2:
            inner.set_state(copy.deepcopy(inner.get_state()))
            twin = pickle.loads(pickle.dumps(inner))
        action = (rng.normal(size=environment.action_space.shape) * scale).astype(
            np.float32 if step % 2 else np.float64
        )
        result = dict(
            zip(("observation", "reward", "terminated", "truncated", "info"), inner.step(action), strict=True)
        )
        rows.append(flat("", {**result, "physics": inner.get_state()["physics"]}))
        if step >= steps // 2:
            rows.append(flat("twin", dict(enumerate(twin.step(action)))))
    observation, info = environment.reset()
    return stacked([*rows, flat("", {"observation": observation, "info": info})])


def play_vectorised(
    env_id: str, mode: str, *, scale: float = 1.0, steps: int = 40, num_threads: int = 2, **kwargs: Any
) -> Arrays:
    import gymnasium

    environments = gymnasium.make_vec(
        f"kitchen_suite.gymnasium_env:{env_id}",
        5,
        vectorization_mode="vector_entry_point",
        num_threads=num_threads,
        autoreset_mode=gymnasium.vector.AutoresetMode(mode),
        max_episode_steps=17,
        **kwargs,
    )
    rng = np.random.default_rng(5)
    observations, infos = environments.reset(seed=[4, 2**40, None, 7, 7] if mode != "Disabled" else 5)
    # A stream that was seeded from fresh entropy cannot be compared.
    observations, infos = environments.reset(seed=[4, 2**40, 1, 7, 7])
    rows = [flat("", {"observation": observations, "info": infos})]
    for _ in range(steps):
        actions = rng.normal(size=environments.action_space.shape) * scale
        result = environments.step(actions)
        row = dict(zip(("observation", "reward", "termination", "truncation", "info"), result, strict=True))
        rows.append(flat("", row))
        ended = result[2] | result[3]
        if mode == "Disabled" and ended.any():
            observations, infos = environments.reset(options={"reset_mask": ended})
            rows.append(flat("reset", {"observation": observations, "info": infos}))
    environments.close()
    return stacked(rows)


def gymnasium_cases() -> Iterator[tuple[str, Case]]:
    kitchen: dict[str, dict[str, Any]] = {
        "defaults": {},
        "four tasks, flat, arrays": {
            "tasks_to_complete": ["microwave", "kettle", "light switch", "slide cabinet"],
            "goal_format": "flat",
            "info_format": "arrays",
        },
        "three tasks that stay": {
            "tasks_to_complete": ["kettle", "bottom burner", "top burner"],
            "threshold": 1.2,
            "remove_task_when_completed": False,
            "terminate_on_tasks_completed": False,
        },
        "target feedback": {"feedback": "target", "velocity_scale": 1.0, "robot_noise_ratio": 0.1},
        "sleep": {"sleep": True},
    }
    cabinet: dict[str, dict[str, Any]] = {
        "defaults": {},
        "bottom, deterministic": {"drawer": "bottom", "gripper": "deterministic", "action_limit": 0.03},
        "noise, grasp": {"reward": "grasp", "observation_noise": {"drawer_position": 0.01, "joint_velocities": 0.1}},
    }
    domains: tuple[tuple[str, str, float, dict[str, dict[str, Any]]], ...] = (
        ("kitchen", KITCHEN, 1.0, kitchen),
        ("open_cabinet", CABINET, 0.05, cabinet),
    )
    for domain, env_id, scale, settings in domains:
        for name, kwargs in settings.items():

            def single(env_id: str = env_id, scale: float = scale, kwargs: dict[str, Any] = kwargs) -> Arrays:
                return play_gymnasium(env_id, scale=scale, **kwargs)

            yield f"gymnasium {domain}, {name}", single
            for mode, num_threads in (("NextStep", 1), ("SameStep", 2), ("Disabled", 3)):

                def many(mode: str = mode, n: int = num_threads, single: Any = (env_id, scale, kwargs)) -> Arrays:
                    return play_vectorised(single[0], mode, scale=single[1], num_threads=n, **single[2])

                yield f"vec {domain}, {name}, {mode}, {num_threads} threads", many


# Commands


def run_command(name: str, *arguments: str) -> str:
    """Runs a command of this tree in this process; returns what it prints."""
    setup = configparser.RawConfigParser()
    setup.read(Path(os.environ["COMPARED_TREE"]) / "setup.cfg", encoding="utf-8")
    scripts = dict(line.split(" = ") for line in setup["options.entry_points"]["console_scripts"].strip().splitlines())
    script = pkgutil.resolve_name(scripts[name])
    # A command of the table; in earlier trees, the bound method of one.
    command = getattr(script, "__self__", script)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        status = command.main(list(arguments))
    assert status == 0, (name, arguments, status, printed.getvalue())
    return printed.getvalue()


def rollout(*arguments: str) -> Arrays:
    """Return, steps and results of the episodes of a rollout, as its table shows them, without the times."""
    printed = run_command("kitchen-rollout", *arguments)
    rows = [line.split() for line in printed.splitlines() if line.split() and line.split()[0].isdecimal()]
    assert rows
    return {f"row_{i}": np.array([*row[:4], *row[5:]]) for i, row in enumerate(rows)}


def record(*arguments: str) -> Arrays:
    """Arrays of recorded episodes."""
    with tempfile.TemporaryDirectory() as folder:
        run_command("kitchen-record", f"--output={folder}/r", *arguments)
        # It exits with 0 only where the replay is equal to the recording.
        run_command("kitchen-replay", f"{folder}/r", "--episodes=all")
        arrays: Arrays = {}
        for path in sorted(Path(folder, "r").glob("episode_*.npz")):
            with np.load(path) as file:
                arrays |= {f"{path.stem}/{name}": file[name] for name in file if name != "metadata"}
    return arrays


def train(*arguments: str, demonstrations: tuple[str, ...] = ()) -> Arrays:
    """Parameters of a small policy after a few updates."""
    small = {"num_envs": 8, "rollouts": 16, "mini_batches": 2, "hidden": [16], "clone_epochs": 3, "value_batches": 1}
    with tempfile.TemporaryDirectory() as folder:
        if demonstrations:
            run_command("kitchen-record", f"--output={folder}/d", *demonstrations)
            arguments = (*arguments, f"--demonstrations={folder}/d")
        steps = ("--num_steps=384", "--eval_interval=128", "--eval_episodes=2", "--restarts=0", "--num_threads=1")
        run_command(
            "kitchen-train", f"--output={folder}/t", f"--hyperparameters={json.dumps(small)}", *steps, *arguments
        )
        with np.load(Path(folder, "t", "policy.npz")) as file:
            return {name: file[name] for name in file if name != "metadata"}


def command_cases() -> Iterator[tuple[str, Case]]:
    yield "rollout kitchen", lambda: rollout("--num_episodes=2")
    yield "rollout open_cabinet trained", lambda: rollout("--domain_name=open_cabinet", "--policy=trained", "--seed=5")
    if has("mink", "daqp"):
        yield "rollout kitchen expert", lambda: rollout("--task_name=all", "--policy=expert", "--num_episodes=2")
        yield "record kitchen expert", lambda: record("--policy=expert", "--num_episodes=4", "--num_envs=3")
    yield "record kitchen random", lambda: record("--task_name=kettle", "--num_episodes=5", "--num_envs=2")
    cabinet = "--domain_name=open_cabinet"
    yield "record open_cabinet trained", lambda: record(cabinet, "--policy=trained", "--num_episodes=4", "--seed=9")
    yield "record open_cabinet random", lambda: record(cabinet, "--num_episodes=6", "--num_envs=4")
    if has("torch", "tensorboard"):
        yield "train open_cabinet", train
        demonstrations = (cabinet, "--policy=trained", "--num_episodes=2")
        yield "train open_cabinet from demonstrations", lambda: train(demonstrations=demonstrations)


def play_all(output: Path, only: str) -> None:
    """Plays all cases on the tree that Python imports; writes their arrays."""
    folder = os.environ["COMPARED_TREE"]
    kitchen_suite = importlib.import_module("kitchen_suite")
    assert Path(str(kitchen_suite.__file__)).resolve().is_relative_to(Path(folder).resolve()), kitchen_suite.__file__
    cases = dict(itertools.chain(dm_env_cases(), gymnasium_cases(), command_cases()))
    chosen = {name: case for name, case in cases.items() if only in name}
    with output.open("wb") as file, tqdm(chosen.items(), desc=output.stem, disable=None) as bar:
        for name, case in bar:
            pickle.dump((name, case()), file)


def read(path: Path) -> dict[str, Arrays]:
    results: dict[str, Arrays] = {}
    with path.open("rb") as file, contextlib.suppress(EOFError):
        while True:
            name, arrays = pickle.load(file)
            results[name] = arrays
    return results


def is_equal(one: np.ndarray, other: np.ndarray) -> bool:
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def compare(before: dict[str, Arrays], after: dict[str, Arrays]) -> bool:
    """Prints a line for each case; returns whether all are equal."""
    all_equal = bool(before) and before.keys() == after.keys()
    if before.keys() != after.keys():
        print(f"cases of one tree alone: {sorted(before.keys() ^ after.keys())}")
    for name in before.keys() & after.keys():
        one, other = before[name], after[name]
        missing = sorted(one.keys() ^ other.keys())
        differing = [key for key in one.keys() & other.keys() if not is_equal(one[key], other[key])]
        all_equal &= not missing and not differing
        verdict = (
            "equal" if not missing and not differing else f"DIFFERENT in {differing}, in one tree alone: {missing}"
        )
        print(f"{name}: {len(one)} arrays, {verdict}"[:300])
    total = sum(array.size for arrays in before.values() for array in arrays.values())
    print(f"{len(before)} cases, {total} elements: {'all equal' if all_equal else 'DIFFERENT'}")
    return all_equal


def extract(revision: str, work: Path) -> Path:
    """Writes the tree of a revision to a folder in `work`."""
    folder = work / "tree"
    folder.mkdir()
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="revision of git to compare this tree with")
    parser.add_argument("--only", default="", help="play only the cases whose name contains this")
    parser.add_argument("--play", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.play:
        play_all(Path(arguments.play), arguments.only)
        return 0
    with tempfile.TemporaryDirectory() as work:
        trees = {"before": extract(arguments.revision, Path(work)), "after": ROOT}
        running = {}
        for name, folder in trees.items():
            environ = {"MUJOCO_GL": "disable", **os.environ, "PYTHONPATH": str(folder), "COMPARED_TREE": str(folder)}
            command = [
                sys.executable,
                __file__,
                arguments.revision,
                "--play",
                f"{work}/{name}",
                "--only",
                arguments.only,
            ]
            running[name] = subprocess.Popen(command, env=environ, cwd=work)
        if failed := [name for name, process in running.items() if process.wait()]:
            print(f"{' and '.join(failed)} failed")
            return 1
        return 0 if compare(*(read(Path(work, name)) for name in trees)) else 1


if __name__ == "__main__":
    sys.exit(main())

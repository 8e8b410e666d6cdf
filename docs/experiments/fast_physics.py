"""Measures of the physics `fast`, for docs/results/fast_measurements.md; each writes its rows to results/fast_*.json.

python docs/experiments/fast_physics.py settings    what each option buys and costs: speed, and successes of the expert
python docs/experiments/fast_physics.py experts     the experts in every control mode, in both physics
python docs/experiments/fast_physics.py policies    the shipped policies in both physics
python docs/experiments/fast_physics.py parting     how far trajectories of the same actions part
python docs/experiments/fast_physics.py random      a million control steps with random actions: NaN, warnings, limits

Rows that are there are not measured again, so an interrupted command continues. `experts` needs the extra of that name,
and an hour of two processors. Seeds were not used for tuning. `docs/scripts/tables.py` makes the tables.
"""

import contextlib
import dataclasses
import functools
import itertools
import statistics
import time
import warnings
from collections.abc import Iterator
from typing import Any
from unittest import mock

import dm_env
import gymnasium
import mujoco
import numpy as np
from experiment import RESULTS, Row, in_processes, measure_missing, play, run_named, timesteps
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import policies, suite
from kitchen_suite.entities.scenes import FastPhysics, KitchenArena
from kitchen_suite.environment import Environment
from kitchen_suite.physics_names import EXACT, FAST, PHYSICS
from kitchen_suite.policies.files import SHIPPED, shipped_as
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, CONTROL_TIMESTEP

TASKS = tuple(task.replace(" ", "_") for task in GOALS)
FIRST_SEED = 60_000

# Episodes of `experts`, in the default control mode and in the others, and of `policies`.
EXPERT_EPISODES = 100
FURTHER_EPISODES = 10
POLICY_EPISODES = 100

# Of `settings`: environments, rounds and control steps of the speeds; modes, and episodes of each task in each.
NUM_ENVS = 32
ROUNDS = 5
SPEED_STEPS = 100
TRIED_MODES = ("joint_velocity", "joint_delta", "ee_delta_pose")
TRIED_EPISODES = 2

# Of `parting`: seeds, and the control steps after which trajectories are compared.
PARTING_SEEDS = 10
PARTING_STEPS = (1, 5, 10, 20, 30, 40)

# Of `random`: control steps by physics, and environments.
RANDOM_STEPS = {FAST: 1_000_000, EXACT: 200_000}
RANDOM_ENVS = 64


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tried(FastPhysics):
    """Fast physics with further options of MuJoCo; their defaults are its own."""

    iterations: int = 100
    ls_iterations: int = 50
    impratio: float = 1.0


def steps_of(count: int, **options: Any) -> Tried:
    """Returns physics with a number of physics steps in a control step of the kitchen."""
    return Tried(timestep=CONTROL_TIMESTEP / count, **options)


SETTINGS: dict[str, Tried] = {
    "8 steps": steps_of(8),
    "7 steps": steps_of(7),
    "**6 steps**": steps_of(6),
    "5 steps": steps_of(5),
    "4 steps": steps_of(4),
    "6 steps, softer contacts (refsafe)": steps_of(6, refsafe=True),
    "6 steps, pyramidal cone": steps_of(6, cone="pyramidal"),
    "6 steps, impratio 10": steps_of(6, impratio=10.0),
    "6 steps, sleep tolerance 1e-8": steps_of(6, sleep_tolerance=1e-8),
    "6 steps, 4 solver and 8 line-search iterations": steps_of(6, iterations=4, ls_iterations=8),
    "6 steps, 2 solver and 4 line-search iterations": steps_of(6, iterations=2, ls_iterations=4),
}


@functools.lru_cache(maxsize=1)
def load(domain: str, task: str, physics: str, mode: str | None = None, **options: Any) -> Environment:
    """Returns an environment; consecutive episodes of a case share it."""
    mode_options = {"control_mode": mode} if mode else {}
    return suite.load(domain, task, {"visuals": False, "physics": physics, **mode_options, **options})


def measure_settings() -> None:
    """Measures speed and successes of the expert with each of `SETTINGS`."""

    def measure(case: Row) -> Row:
        settings = SETTINGS[case["settings"]]
        with mock.patch.object(KitchenArena, "fast_physics", settings):
            failed = []
            for mode, task in itertools.product(TRIED_MODES, TASKS):
                environment = load("kitchen", task, FAST, mode)
                lost = sum(not play(environment, "expert", FIRST_SEED + i)[0] for i in range(TRIED_EPISODES))
                failed += [f"{task} in {mode}"] if lost else []
                load.cache_clear()
            return {**dataclasses.asdict(settings), "ratio": speed_ratio(), "failed": failed}

    measure_missing(RESULTS / "fast_settings.json", ({"settings": name} for name in SETTINGS), measure)


def speed_ratio() -> float:
    """Returns how much faster vectorised kitchens with random actions are in the present fast physics, on a thread."""
    made = [
        gymnasium.make_vec(suite.DOMAINS["kitchen"].env_id, NUM_ENVS, num_threads=1, physics=physics)
        for physics in PHYSICS
    ]
    ratios = []
    for number in range(ROUNDS + 1):
        seconds = [run(each, number) for each in made]
        # The first round warms up.
        ratios += [seconds[0] / seconds[1]] if number else []
    for each in made:
        each.close()
    return statistics.median(ratios)


def run(environments: gymnasium.vector.VectorEnv, seed: int) -> float:
    """Plays some control steps; returns the processor time [s]."""
    actions = np.random.default_rng(seed).uniform(-1, 1, (SPEED_STEPS, *environments.action_space.shape))
    environments.reset(seed=seed)
    started = time.process_time()
    for action in actions.astype(np.float32):
        environments.step(action)
    return time.process_time() - started


def measure_experts() -> None:
    """Plays the experts in both physics, in as many processes as there are CPUs."""
    kitchen = [("kitchen", task, mode) for mode in CONTROL_MODES for task in TASKS]
    table = [("microwave_table", "open", mode) for mode in OFFSET_MODES]
    names = ("domain", "task", "mode")
    cases = (dict(zip(names, case, strict=True)) for case in (*kitchen, *table))
    measure_missing(RESULTS / "fast_experts.json", cases, measure_expert, in_processes)


def measure_expert(case: Row) -> Row:
    """Plays an expert in both physics; returns successes and median control steps of each."""
    count = EXPERT_EPISODES if case["mode"] == next(iter(CONTROL_MODES)) else FURTHER_EPISODES
    row: Row = {"episodes": count}
    for physics in PHYSICS:
        environment = load(case["domain"], case["task"], physics, case["mode"])
        played = [play(environment, "expert", FIRST_SEED + i) for i in range(count)]
        steps = [steps for success, steps in played if success]
        row[physics] = {"success": len(steps), "steps": statistics.median(steps) if steps else None}
    return row


def measure_policies() -> None:
    """Plays the shipped policies in both physics, with the options with which they were trained."""

    def measure(case: Row) -> Row:
        path = shipped_as(case["policy"])
        record, row = policies.load_policy(path).metadata, {}
        for physics in PHYSICS:
            arguments = {**record["task_kwargs"], "physics": physics, "visuals": False}
            environment = suite.load(record["domain_name"], record["task_name"], arguments)
            played = [
                play(environment, f"trained(file={str(path)!r})", FIRST_SEED + i)[0] for i in range(POLICY_EPISODES)
            ]
            row[physics] = sum(played)
        return {"episodes": POLICY_EPISODES, **row}

    shipped = sorted(path.stem for path in SHIPPED.glob("*.npz"))
    names = [name for name in shipped if policies.load_policy(shipped_as(name)).metadata["domain_name"] == "kitchen"]
    measure_missing(RESULTS / "fast_policies.json", ({"policy": name} for name in names), measure)


def measure_parting() -> None:
    """Plays the expert's actions of the exact physics in the fast one, and compares."""

    def measure(case: Row) -> Row:
        apart = [part(case["task"], FIRST_SEED + i) for i in range(PARTING_SEEDS)]
        return {
            str(step): [statistics.median(column) for column in zip(*(each[step] for each in apart), strict=True)]
            for step in PARTING_STEPS
            if all(step in each for each in apart)
        }

    cases = ({"task": task.replace(" ", "_")} for task in DEFAULT_TASKS)
    measure_missing(RESULTS / "fast_parting.json", cases, measure)


def part(task: str, seed: int) -> dict[int, tuple[float, float, float]]:
    """Returns differences by control step: arm joints [rad], positions of objects [rad, m], contact forces [N]."""
    exact, fast = (
        suite.load("kitchen", task, {"visuals": False, "physics": physics, "control_mode": "joint_position"})
        for physics in PHYSICS
    )
    for environment in (exact, fast):
        environment.random_state.seed(seed)
    fast.reset()
    expert = policies.find("expert")(exact, np.random.default_rng(seed))

    def act(timestep: dm_env.TimeStep) -> NDArray[np.float64]:
        """Makes the control step of the fast physics with the action of the exact one."""
        action = expert(timestep)
        fast.step(action)
        return action

    apart = {}
    for step, _ in enumerate(itertools.islice(timesteps(exact, act), max(PARTING_STEPS) + 1)):
        one, other = (np.array(environment.physics.data.qpos) for environment in (exact, fast))
        forces = [contact_force(environment) for environment in (exact, fast)]
        apart[step] = (
            float(np.abs(one - other)[:7].max()),
            float(np.abs(one - other)[9:].max()),
            abs(forces[0] - forces[1]),
        )
    return apart


def contact_force(environment: Environment) -> float:
    """Returns the sum of the magnitudes of all contact forces on the robot [N]."""
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    wrench, total = np.zeros(6), 0.0
    robot = {body for body in range(model.nbody) if model.body(body).name.startswith("franka/")}
    for i in range(data.ncon):
        if robot & {int(model.geom_bodyid[geom]) for geom in data.contact.geom[i]}:
            mujoco.mj_contactForce(model, data, i, wrench)
            total += float(np.linalg.norm(wrench[:3]))
    return total


def measure_random() -> None:
    """Steps random actions; counts numbers that are not finite and warnings, and measures how far limits are passed."""

    def measure(case: Row) -> Row:
        environments = gymnasium.make_vec(
            suite.DOMAINS[case["domain"]].env_id,
            RANDOM_ENVS,
            vectorization_mode="vector_entry_point",
            physics=case["physics"],
            max_episode_steps=200,
        )
        steps = RANDOM_STEPS[case["physics"]]
        bad, worst, kinds = 0, {"hinge": 0.0, "slide": 0.0}, set()
        with contextlib.closing(environments), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            environments.reset(seed=FIRST_SEED)
            for action in random_actions(environments.action_space.shape, steps // RANDOM_ENVS):
                _, rewards, *_ = environments.step(action)
                batch, model = environments._episodes.batch, environments._episodes.batch.model  # noqa: SLF001
                bad += int((~np.isfinite(batch.state)).sum() + (~np.isfinite(rewards)).sum())
                kinds |= {int(kind) for kind in np.flatnonzero(batch.warning[:, :, 1].any(axis=0))}
                for joint, excess in passed_limits(model, np.array(batch.qpos)):
                    worst[joint] = max(worst[joint], excess)
        names = [mujoco.mjtWarning(kind).name for kind in sorted(kinds)]
        return {"steps": steps, "not_finite": bad, "warnings": names, **worst}

    cases = ({"domain": name, "physics": each} for name in ("kitchen", "microwave_table") for each in RANDOM_STEPS)
    measure_missing(RESULTS / "fast_random.json", cases, measure)


def random_actions(shape: tuple[int, ...], count: int) -> Iterator[NDArray[np.float32]]:
    """Yields actions `(n, k)`: random walks, with a new amplitude in each episode."""
    random, action = np.random.default_rng(FIRST_SEED), np.zeros(shape)
    for step in tqdm(range(count), desc="control steps", disable=None):
        if step % 200 == 0:
            amplitude = random.choice([0.05, 0.3, 1.0], (shape[0], 1))
        action = np.clip(action + amplitude * random.uniform(-1, 1, shape), -1, 1)
        yield action.astype(np.float32)


def passed_limits(model: mujoco.MjModel, qpos: NDArray[np.float64]) -> Iterator[tuple[str, float]]:
    """Yields kinds of the objects' joints, and how far the farthest is beyond its range [rad, m]."""
    kinds = {"hinge": mujoco.mjtJoint.mjJNT_HINGE, "slide": mujoco.mjtJoint.mjJNT_SLIDE}
    is_robot = np.array([model.joint(i).name.startswith("franka/") for i in range(model.njnt)])
    for name, kind in kinds.items():
        (joints,) = np.nonzero((model.jnt_type == int(kind)) & (model.jnt_limited == 1) & ~is_robot)
        if joints.size:
            low, high = model.jnt_range[joints].T
            values = qpos[:, model.jnt_qposadr[joints]]
            yield name, float(np.maximum(low - values, values - high).max())


MEASURES = {
    "settings": measure_settings,
    "experts": measure_experts,
    "policies": measure_policies,
    "parting": measure_parting,
    "random": measure_random,
}

if __name__ == "__main__":
    run_named(__doc__, MEASURES)

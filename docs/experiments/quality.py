"""Measures how clean the experts and the policies that come with the package are, for docs/guide/quality.md.

`python docs/experiments/quality.py scores` evaluates each under the protocol `clean`, and each of seven tasks from its
usual start, in some minutes. `python docs/experiments/quality.py objects` counts which objects the expert disturbs.
`python docs/experiments/quality.py speed` measures the speed of environments with `quality=True` as a share of that
without, side by side, and that of MuJoCo's physics alone, with and without the sensors. Results are in
results/quality_scores.json, quality_objects.json and quality_speed.json; what has a row already is not measured again.
"""

import collections
import functools
import statistics
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import mujoco
import numpy as np
from experiment import RESULTS, Row, measure_missing, play, run_named
from kitchen_policy import KINDS

import kitchen_suite
from kitchen_suite import suite
from kitchen_suite.environment import Environment
from kitchen_suite.policies.files import SHIPPED

# Episodes of a policy under the protocol, and of a single task from its usual start.
EPISODES = 30
TASK_EPISODES = 20

TASKS = ("microwave", "kettle", "slide_cabinet", "hinge_cabinet", "light_switch", "bottom_burner", "top_burner")

# Policies by domain and task, whose episodes have varied starts.
VARIED = (
    *(("kitchen", "random_4", policy) for policy in ("expert", "trained", "pixels", "random")),
    ("kitchen", "all", "expert"),
    *(("open_cabinet", "top_drawer", policy) for policy in ("expert", "trained")),
    ("microwave_table", "open", "expert"),
    ("kitchens", "open", "expert"),
)

MEASURES = (
    "success",
    "clean_success",
    "objects_disturbed",
    "stray_contacts",
    "peak_arm_contact_force",
    "peak_contact_force",
    "energy",
    "path_length",
    "log_dimensionless_jerk",
    "control_steps",
)

# Rounds of the measurement of speed, and the least time of each [s].
ROUNDS = 9
ROUND_SECONDS = 0.3


def score_cases() -> list[Row]:
    """Returns the evaluations.

    `shipped` is the package's policy for one task alone, trained from its usual start, `pixels` that from images.
    """
    varied = [{"domain": domain, "task": task, "policy": policy, "starts": "varied"} for domain, task, policy in VARIED]
    usual = [
        {"domain": "kitchen", "task": task, "policy": policy, "starts": "usual"}
        for task in TASKS
        for policy in ("expert", "shipped")
    ]
    return [*usual, *varied]


def score(case: Row) -> Row:
    """Returns the scores of an evaluation, and their intervals."""
    is_varied = case["starts"] == "varied"
    task_kwargs: dict[str, Any] = {} if is_varied else {"variations": None}
    if case["policy"] == "pixels":
        task_kwargs |= KINDS["pixels"]
    files = {"shipped": SHIPPED / f"{case['task']}.npz", "pixels": SHIPPED / "pixels.npz"}
    evaluation = kitchen_suite.evaluate(
        files.get(case["policy"], case["policy"]),
        protocol="clean",
        domain_name=case["domain"],
        task_name=case["task"],
        task_kwargs=task_kwargs,
        num_episodes=EPISODES if is_varied else TASK_EPISODES,
    )
    scores = evaluation.scores
    intervals = {name: scores["intervals"][name] for name in MEASURES}
    return {
        "episodes": evaluation.plan.num_episodes,
        **{name: scores[name] for name in MEASURES},
        "intervals": intervals,
    }


def object_cases() -> list[Row]:
    """Returns the tasks of which the expert plays episodes with varied starts."""
    kitchen = [{"domain": "kitchen", "task": task} for task in TASKS]
    return [*kitchen, {"domain": "open_cabinet", "task": "top_drawer"}, {"domain": "microwave_table", "task": "open"}]


@functools.lru_cache(maxsize=1)
def load(domain: str, task: str) -> Environment:
    """Returns an environment; consecutive episodes of a task share it."""
    return suite.load(domain, task, {"visuals": False, "variations": "start", "quality": True})


def count_objects(case: Row) -> Row:
    """Returns in how many episodes the expert disturbs each object, and in how many its arm is hit."""
    environment = load(case["domain"], case["task"])
    objects: collections.Counter[str] = collections.Counter()
    stray = 0
    for seed in range(TASK_EPISODES):
        play(environment, "expert", seed)
        objects.update(environment.task.disturbed_objects)
        stray += environment.task.quality["stray_contacts"] > 0
    return {"episodes": TASK_EPISODES, "objects": dict(objects.most_common()), "stray_contacts": stray}


def speed_cases() -> list[Row]:
    """Returns the environments whose speed is measured."""
    domains = [("kitchen", "exact"), ("kitchen", "fast"), ("open_cabinet", "exact")]
    return [
        {"domain": domain, "physics": physics, "environments": count}
        for domain, physics in domains
        for count in (1, 32)
    ]


def measure_speed(case: Row) -> Row:
    """Returns the speed with quality as a share of the speed without; for one, also of MuJoCo's physics steps alone."""
    found = {"ratio": _ratio(*(_stepper(case, quality=quality) for quality in (False, True))), "rounds": ROUNDS}
    if case["environments"] == 1:
        found["physics_ratio"] = _ratio(*(_physics_stepper(case, quality=quality) for quality in (False, True)))
    return found


def _ratio(first: Callable[[int], float], second: Callable[[int], float]) -> float:
    """Returns the median over rounds of how long the first takes for the steps of the second, in processor time."""
    steps = max(1, round(ROUND_SECONDS / first(5) * 5))
    second(5)
    return round(statistics.median(first(steps) / second(steps) for _ in range(ROUNDS)), 3)


def _physics_stepper(case: Row, *, quality: bool) -> Callable[[int], float]:
    """Returns a function that makes control steps of the physics alone, and returns the processor time [s]."""
    options = {"physics": case["physics"], "quality": quality, "visuals": False}
    environment = suite.load(case["domain"], next(iter(suite.DOMAINS[case["domain"]].tasks)), options)
    environment.reset()
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    positions, physics_steps = data.qpos.copy(), environment.task.physics_steps_per_control_step

    def run(steps: int) -> float:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = positions
        # Actuators hold the positions of the robot's joints, which come first.
        data.ctrl[:] = positions[: model.nu]
        started = time.process_time()
        mujoco.mj_step(model, data, nstep=steps * physics_steps)
        return time.process_time() - started

    return run


def _stepper(case: Row, *, quality: bool) -> Callable[[int], float]:
    """Returns a function that makes some control steps, and returns the processor time that they took [s]."""
    domain, count = suite.DOMAINS[case["domain"]], case["environments"]
    options = {"physics": case["physics"], "quality": quality, "max_episode_steps": 10**9}
    if count == 1:
        env = gymnasium.make(domain.env_id, disable_env_checker=True, **options)
    else:
        env = gymnasium.make_vec(domain.env_id, count, vectorization_mode="vector_entry_point", **options)
    env.reset(seed=0)
    shape = env.action_space.shape
    assert shape is not None
    actions = 0.1 * np.random.default_rng(0).normal(size=(20, *shape)).astype(np.float32)

    def run(steps: int) -> float:
        env.reset(seed=0)
        started = time.process_time()
        for number in range(steps):
            env.step(actions[number % len(actions)])
        return time.process_time() - started

    return run


def measure_scores() -> None:
    """Measures the scores that are missing."""
    measure_missing(RESULTS / "quality_scores.json", score_cases(), score)


def measure_objects() -> None:
    """Counts the objects that are missing."""
    measure_missing(RESULTS / "quality_objects.json", object_cases(), count_objects)


def measure_speeds() -> None:
    """Measures the speeds that are missing."""
    measure_missing(RESULTS / "quality_speed.json", speed_cases(), measure_speed)


if __name__ == "__main__":
    run_named(__doc__, {"scores": measure_scores, "objects": measure_objects, "speed": measure_speeds})

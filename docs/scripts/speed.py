"""Measures of which the pages have figures; each prints a table.

python docs/scripts/speed.py policies            processor time of an action of the policies that come with the package
python docs/scripts/speed.py evaluation          seconds of evaluations of a network, as inside a training loop
python docs/scripts/speed.py stable_baselines3   control steps per second of its adapter and of its own `DummyVecEnv`
python docs/scripts/speed.py web                 size of a web page of 280 control steps, and the time to make it
"""

import os
import statistics
import tempfile
import time
import unittest.mock
from pathlib import Path

import mujoco.batch
import numpy as np
from experiment import run_named
from tabulate import tabulate

import kitchen_suite
from kitchen_suite import policies, suite
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.files import SHIPPED

ACTIONS = 2_000

# Episodes of an evaluation.
EVALUATED = 50

# Environments of Stable-Baselines3 with their arguments, their number, and the steps and rounds of the comparison.
ADAPTED = {
    "KitchenSuite/FrankaKitchen-v1": {"goal_format": "flat"},
    "KitchenSuite/FrankaOpenCabinet-v1": {"action_limit": 0.02},
}
NUM_ENVS, STEPS, ROUNDS = 16, 100, 5

WEB_STEPS = 280


def milliseconds(name: str) -> float:
    """Returns the median time of an action of a policy [ms]."""
    policy = load_policy(SHIPPED / f"{name}.npz")
    metadata, times = policy.metadata, []
    kwargs = {**metadata["task_kwargs"], "visuals": False}
    with suite.load(metadata["domain_name"], metadata["task_name"], kwargs) as environment:
        act = policy.episode(environment.task)
        timestep = environment.reset()
        for _ in range(ACTIONS):
            started = time.process_time()
            action = act(timestep)
            times.append(time.process_time() - started)
            timestep = environment.step(action)
            if timestep.last():
                timestep = environment.reset()
    return 1000 * statistics.median(times)


def measure_policies() -> None:
    """Prints the median time of 2,000 actions of each policy, all threads together."""
    rows = [(path.stem, f"{milliseconds(path.stem):.3f}") for path in sorted(SHIPPED.glob("*.npz"))]
    print(tabulate(rows, headers=("policy", "milliseconds of an action")))


def measure_evaluation() -> None:
    """Prints the time of 50 episodes of the protocol `default`, of a network that learned them and an untrained one.

    All 50 are played at once. The untrained network acts for all of them in one call; its episodes last as long as the
    protocol allows. It is also played in fast physics. The last column has the part of the time that MuJoCo's physics
    steps take.
    """
    rng = np.random.default_rng(0)
    # 59 numbers of the observation and the mask of the seven tasks.
    layers = [rng.normal(scale=size**-0.5, size=(size, width)) for size, width in ((66, 256), (256, 256), (256, 9))]

    def untrained(observations):
        for weights in layers:
            observations = np.tanh(observations @ weights)
        return observations

    in_batches = {"takes": "batch", "task_kwargs": {"obs_type": "state"}}
    in_fast_physics = {"takes": "batch", "task_kwargs": {**in_batches["task_kwargs"], "physics": "fast"}}
    cases = [
        ("trained", "trained", {}),
        ("untrained", untrained, in_batches),
        ("untrained, fast physics", untrained, in_fast_physics),
    ]
    rows = [evaluation_row(*case) for case in cases]
    print(tabulate(rows, ("network", "success", "control steps of an episode", "seconds", "of these physics steps")))


def evaluation_row(name, policy, arguments):
    """Returns a row of the table of `measure_evaluation`."""
    physics_seconds = []
    step = mujoco.batch.Batch.step

    def timed_step(*args):
        started = time.perf_counter()
        step(*args)
        physics_seconds.append(time.perf_counter() - started)

    started = time.perf_counter()
    with unittest.mock.patch.object(mujoco.batch.Batch, "step", timed_step):
        evaluation = kitchen_suite.evaluate(
            policy, num_episodes=EVALUATED, num_envs=EVALUATED, num_threads=os.cpu_count(), **arguments
        )
    seconds = time.perf_counter() - started
    success, steps = (evaluation.scores[name] for name in ("success", "control_steps"))
    return name, f"{success:.0%}", f"{steps:.0f}", f"{seconds:.1f}", f"{sum(physics_seconds):.1f}"


def rate(environments, actions):
    """Returns control steps per second, over all environments."""
    environments.reset()
    started = time.perf_counter()
    for action in actions:
        environments.step(action)
    return len(actions) * environments.num_envs / (time.perf_counter() - started)


def adapter_row(name, settings):
    """Returns a row of the table: name, median rates of both, which alternate, and the median of their ratios."""
    from stable_baselines3.common.env_util import make_vec_env

    from kitchen_suite.adapters import stable_baselines3

    env_id = f"kitchen_suite.gymnasium_env:{name}"
    fast = stable_baselines3.make_vec_env(env_id, NUM_ENVS, num_threads=1, **settings)
    plain = make_vec_env(env_id, NUM_ENVS, env_kwargs=settings)
    space = plain.action_space
    actions = np.random.default_rng(0).uniform(space.low, space.high, (STEPS, NUM_ENVS, *space.shape))
    rates = [(rate(plain, actions), rate(fast, actions)) for _ in range(ROUNDS)]
    ratio = statistics.median(one / other for other, one in rates)
    return name, *(statistics.median(column) for column in zip(*rates, strict=True)), ratio


def measure_adapter() -> None:
    """Prints the speed of Stable-Baselines3 with random actions, on one thread."""
    headers = [f"{NUM_ENVS} environments", "DummyVecEnv", "SuiteVecEnv", "ratio"]
    rows = [adapter_row(name, settings) for name, settings in ADAPTED.items()]
    print(tabulate(rows, headers, "github", floatfmt=(None, ",.0f", ",.0f", ".2f")))


def web_row(domain: str, path: Path) -> str:
    """Returns the row of a domain, after its page has been written to a path.

    The time is that of making the scene, of the frames and of writing the page, without that of the episode.
    """
    from kitchen_suite.rendering import cameras
    from kitchen_suite.viewer.episode_page import SceneRecorder
    from kitchen_suite.viewer.web_page import WebPage

    options = {"visuals": True, "render_quality": "fast"}
    environment = suite.load(domain, suite.default_task(domain), task_kwargs={**options, "random": 0})
    timestep = environment.reset()
    policy = policies.POLICIES["random"](environment, np.random.default_rng(0))
    seconds, page = 0.0, WebPage()
    with SceneRecorder() as recorder:
        started = time.perf_counter()
        recorder.start([environment.physics], cameras.find_camera(environment.physics, "overview"))
        seconds += time.perf_counter() - started
        for _ in range(WEB_STEPS):
            timestep = environment.step(policy(timestep))
            started = time.perf_counter()
            recorder.add_frame([environment.physics], environment.control_timestep())
            seconds += time.perf_counter() - started
        started = time.perf_counter()
        page.add(recorder.finish(1.0), {"name": domain, "parts": []})
        path.write_text(page.html(domain), "utf-8")
        seconds += time.perf_counter() - started
    return f"| {domain} | {path.stat().st_size / 1e6:.1f} MB | {seconds:.1f} s |"


def measure_web() -> None:
    """Prints sizes and times of web pages."""
    with tempfile.TemporaryDirectory() as folder:
        for domain in suite.DOMAINS:
            print(web_row(domain, Path(folder) / "page.html"), flush=True)


if __name__ == "__main__":
    run_named(
        __doc__,
        {
            "policies": measure_policies,
            "evaluation": measure_evaluation,
            "stable_baselines3": measure_adapter,
            "web": measure_web,
        },
    )

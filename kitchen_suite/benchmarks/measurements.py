"""Measures control steps per second, the time of a control step beyond physics, and memory."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import concurrent.futures
import contextlib
import itertools
import multiprocessing
import resource
import signal
import statistics
import time
import timeit
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import gymnasium
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite.benchmarks.cases import NUM_THREADS, BenchmarkDomain, Case
from kitchen_suite.environment import Environment

# Control steps per second in each round, by name of the case.
Rates = dict[str, list[float]]

_SOAK_SAMPLES = 20
_MAX_ENVPOOL = 128  # Number of EnvPool's environments that still fit into the memory of common machines.


def measure_rates(domain: BenchmarkDomain, cases: Mapping[str, Case], *, rounds: int, steps: int) -> Rates:
    """Measures the control steps per second of each case, by name, in each of some rounds of `steps` control steps.

    In a round every case runs one episode with the same actions; a vectorised case also uses actions of its own for its
    further environments. One more round, for warming up, comes first and does not count.
    """
    rng = np.random.default_rng(0)
    max_num_envs = max(max(case.num_envs, 1) for case in cases.values())
    rates: Rates = {name: [] for name in cases}
    with tqdm(total=(rounds + 1) * len(cases), disable=None) as bar:
        for _ in range(rounds + 1):
            actions = domain.draw_actions(rng, (steps, max_num_envs))
            for name, case in cases.items():
                bar.set_description(name)
                rates[name].append(episode_rate(case, actions))
                bar.update()
    return {name: values[1:] for name, values in rates.items()}


def episode_rate(case: Case, actions: NDArray[np.float64]) -> float:
    """Measures the control steps per second of one episode, over all environments of a case.

    Of the actions `(steps, m, n)` the case uses the first columns of the second axis.
    """
    used = actions[:, : case.num_envs].copy() if case.num_envs else actions[:, 0].copy()
    start = time.perf_counter()
    case.episode(used)
    return len(actions) * max(case.num_envs, 1) / (time.perf_counter() - start)


def round_ratios(rates: Rates, numerator: str, denominator: str) -> dict[str, float]:
    """Returns median, minimum and maximum of the ratio of two cases' rates in each round."""
    ratios = [above / below for above, below in zip(rates[numerator], rates[denominator], strict=True)]
    return {"ratio": statistics.median(ratios), "min": min(ratios), "max": max(ratios)}


def summarize(rates: Rates, cases: Mapping[str, Case]) -> dict[str, dict[str, float]]:
    """Returns for each case its ratio to the first case, in total and per thread, and its median rate."""
    first = next(iter(rates))
    summary = {}
    for name, values in rates.items():
        ratio = round_ratios(rates, name, first)
        per_thread = {"ratio_per_thread": ratio["ratio"] / cases[name].num_threads}
        summary[name] = ratio | per_thread | {"steps_per_second": statistics.median(values)}
    return summary


def named_ratios(rates: Rates, ratios: Mapping[str, tuple[str, str]]) -> dict[str, dict[str, float]]:
    """Returns statistics of named ratios, given as (numerator case, denominator case)."""
    return {name: round_ratios(rates, *pair) for name, pair in ratios.items()}


def overhead(environment: Environment, adapter: gymnasium.Env, *, repeats: int) -> dict[str, float]:
    """Measures the time of a control step without its physics [us]: the minimum over `repeats` measurements.

    The environment, and that of the Gymnasium adapter, have no time limit.
    """
    environment.reset()
    adapter.reset()
    action = np.zeros(environment.action_spec().shape)
    task, physics, random_state = environment.task, environment.physics, environment.random_state

    def run_hooks() -> None:
        task.before_step(physics, action, random_state)
        task.after_step(physics, random_state)
        task.get_reward(physics)
        task.should_terminate_episode(physics)

    measured: dict[str, Callable[[], object]] = {
        "the task's hooks": run_hooks,
        "suite.load": lambda: environment.step(action),
        "Gymnasium adapter": lambda: adapter.step(action),
    }
    calls = 2_000  # Of one measurement.
    with mock.patch.object(mjcf.Physics, "step"):
        seconds = {name: min(timeit.repeat(step, number=calls, repeat=repeats)) for name, step in measured.items()}
    return {name: 1e6 * least / calls for name, least in seconds.items()}


def throughput(domain: BenchmarkDomain, environments: gymnasium.vector.VectorEnv, *, num_steps: int) -> float:
    """Measures the control steps per second of vectorised environments, over about `num_steps` in total."""
    num_envs = environments.num_envs
    actions = domain.draw_actions(np.random.default_rng(0), (max(num_steps // num_envs, 1), num_envs))
    environments.reset(seed=0)
    environments.step(actions[0])
    start = time.perf_counter()
    for action in actions:
        environments.step(action)
    return len(actions) * num_envs / (time.perf_counter() - start)


def resident_memory() -> float:
    """Returns the memory that this process holds in RAM [MiB]; Linux only."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def memory_in_use(domain: BenchmarkDomain, name: str, num_envs: int) -> float:
    """Returns the memory that this process holds with vectorised environments that have made a few steps [MiB]."""
    # Ctrl-C, which the command reports, ends the process silently.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    environments = domain.vector_env(name, num_envs, 1)
    environments.reset()
    for actions in domain.draw_actions(np.random.default_rng(0), (5, num_envs)):
        environments.step(actions)
    return resident_memory()


def memory_per_environment(domain: BenchmarkDomain, name: str, num_envs: int) -> float:
    """Measures the memory of each environment beyond the first [MiB], in new processes with one and all of them."""
    memory = []
    for count in (1, num_envs):
        with concurrent.futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
            memory.append(executor.submit(memory_in_use, domain, name, count).result())
    return (memory[1] - memory[0]) / (num_envs - 1)


def scaling(domain: BenchmarkDomain, num_envs: Sequence[int], num_steps: int) -> list[dict[str, Any]]:
    """Measures throughput by number of environments and threads, and memory per environment [MiB] on one thread.

    Each measurement of throughput makes `num_steps` control steps, over all environments.
    """
    rows = []
    for name, count, threads in tqdm([*itertools.product(domain.vector_names, num_envs, NUM_THREADS)], disable=None):
        if name == "EnvPool" and count > _MAX_ENVPOOL:
            continue
        with contextlib.closing(domain.vector_env(name, count, threads)) as environments:
            rate = throughput(domain, environments, num_steps=num_steps)
        memory = memory_per_environment(domain, name, count) if count > 1 and threads == 1 else None
        sizes = {"num_envs": count, "num_threads": threads}
        rows.append({"vector_env": name, **sizes, "memory": memory, "steps_per_second": rate})
    return rows


def soak(domain: BenchmarkDomain, num_envs: int, num_steps: int) -> dict[str, list[float]]:
    """Samples the memory [MiB] in the course of a long run of the suite's vectorised environments.

    `num_steps` is rounded up to a multiple of the number of samples and environments.
    """
    environments = domain.vector_env("vectorised", num_envs, NUM_THREADS[-1])
    rng = np.random.default_rng(0)
    steps_per_sample = -(-num_steps // (_SOAK_SAMPLES * num_envs))
    environments.reset(seed=0)
    done, memory = [0.0], [resident_memory()]
    with tqdm(total=_SOAK_SAMPLES * steps_per_sample * num_envs, unit="steps", disable=None) as bar:
        for _ in range(_SOAK_SAMPLES):
            for _ in range(steps_per_sample):
                environments.step(domain.draw_actions(rng, (num_envs,)))
                bar.update(num_envs)
            done.append(done[-1] + steps_per_sample * num_envs)
            memory.append(resident_memory())
    return {"num_steps": done, "memory": memory}

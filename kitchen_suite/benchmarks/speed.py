"""Measures control steps per second, and the time that a control step takes beyond physics."""

import statistics
import time
import timeit
from collections.abc import Callable, Mapping
from unittest import mock

import gymnasium
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite.benchmarks.cases import BenchmarkDomain, Case
from kitchen_suite.environment import Environment

# Control steps per second in each round, by name of the case.
Rates = dict[str, list[float]]


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

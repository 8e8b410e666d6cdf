"""Measures speed and memory of the suite against bare MuJoCo and other implementations.

python docs/experiments/benchmarks.py                                        ratios of control steps per second
python docs/experiments/benchmarks.py --domain_name=open_cabinet --rounds=31

Machines are shared and noisy, so only ratios are comparable: in every round each case plays one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table has the median over the rounds.
`pip install envpool` adds rows of EnvPool. `rendering.py` measures frames, and `scaling.py` more threads and
environments.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import argparse
import statistics
import time
import timeit
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from benchmark_cases import DOMAINS, BenchmarkDomain, Case
from benchmark_tables import print_results
from experiment import make_parser, positive
from numpy.typing import NDArray
from tqdm import tqdm

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
    for each in (environment, adapter.environment):
        each.physics.step = _make_no_step
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
    seconds = {name: min(timeit.repeat(step, number=calls, repeat=repeats)) for name, step in measured.items()}
    return {name: 1e6 * least / calls for name, least in seconds.items()}


def _make_no_step(count: int = 1) -> None:
    """Takes the place of the physics steps of a control step."""


def measure_speed(domain: BenchmarkDomain, num_envs: int, rounds: int, steps: int) -> dict[str, Any]:
    """Measures all cases in episodes of some control steps, their ratios, and the time of a step beyond physics."""
    cases = domain.cases(num_envs)
    rates = measure_rates(domain, cases, rounds=rounds, steps=steps)
    return {
        "results": summarize(rates, cases),
        "ratios": named_ratios(rates, domain.ratios(num_envs)),
        "overhead": overhead(domain.load(visuals=False), domain.adapter(), repeats=rounds),
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Returns the results of a domain: its tables by name."""
    domain = DOMAINS[options.domain_name]
    steps = options.max_episode_steps or domain.domain.episode_steps
    return measure_speed(domain, options.num_envs, options.rounds, steps)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("--domain_name", choices=DOMAINS, default="kitchen")
    parser.add_argument("--rounds", type=positive, default=9, help="rounds that count")
    parser.add_argument("--max_episode_steps", type=positive, help="control steps of an episode")
    parser.add_argument("--num_envs", type=positive, default=32, help="environments stepped together")
    parser.add_argument("--json", action="store_true", help="print JSON in place of tables")
    options = parser.parse_args(arguments)
    print_results(parser, options, "speed", measure(options))


if __name__ == "__main__":
    main()

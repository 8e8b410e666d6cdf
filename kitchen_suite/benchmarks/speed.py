"""Measures control steps per second, and makes ratios of them round by round."""

import itertools
import statistics
import time
import timeit
from collections.abc import Mapping, Sequence
from unittest import mock

import gymnasium
import numpy as np
from dm_control import mjcf
from tqdm import tqdm

from kitchen_suite.benchmarks.cases import Contender, Domain
from kitchen_suite.environment import Environment

Rates = dict[str, list[float]]


def measure(domain: Domain, contenders: Mapping[str, Contender], *, rounds: int, steps: int) -> Rates:
    """Control steps per second of each contender in each round; a first round to warm up is not counted.

    In a round all contenders make one episode with the same actions; vectorised ones go on to further columns of them.
    """
    rates: Rates = {name: [] for name in contenders}
    rng = np.random.default_rng(0)
    most = max(max(one.environments, 1) for one in contenders.values())
    work = tqdm(itertools.product(range(rounds + 1), contenders), total=(rounds + 1) * len(contenders), disable=None)
    for number, name in work:
        work.set_description(name)
        if name == next(iter(contenders)):
            actions = domain.draw(rng, (steps, most))
        contender = contenders[name]
        own = actions[:, : contender.environments].copy() if contender.environments else actions[:, 0].copy()
        start = time.perf_counter()
        contender.episode(own)
        if number:
            rates[name].append(steps * max(contender.environments, 1) / (time.perf_counter() - start))
    return rates


def spread(ratios: Sequence[float]) -> dict[str, float]:
    """Median, least and greatest of some ratios."""
    return {"ratio": statistics.median(ratios), "least": min(ratios), "greatest": max(ratios)}


def ratios(rates: Rates, above: str, below: str) -> list[float]:
    """Rate of one contender over that of another, round by round."""
    return [one / other for one, other in zip(rates[above], rates[below], strict=True)]


def summarize(rates: Rates, contenders: Mapping[str, Contender]) -> dict[str, dict[str, float]]:
    """For each contender: ratio to the first one, the same for one of its threads, steps per second (median)."""
    baseline = next(iter(rates))
    return {
        name: {
            **spread(ratios(rates, name, baseline)),
            "ratio_per_thread": statistics.median(ratios(rates, name, baseline)) / contenders[name].threads,
            "steps_per_second": statistics.median(values),
        }
        for name, values in rates.items()
    }


def compare(rates: Rates, comparisons: Mapping[str, tuple[str, str]]) -> dict[str, dict[str, float]]:
    """The domain's further ratios."""
    return {name: spread(ratios(rates, above, below)) for name, (above, below) in comparisons.items()}


def overhead(environment: Environment, adapter: gymnasium.Env, *, steps: int = 2_000) -> dict[str, float]:
    """What a control step costs above physics, which is left out here: least of some runs [us].

    Args:
      environment: the suite's, without a time limit.
      adapter: over another one of its kind.
      steps: control steps of a run.
    """
    for reset in (environment.reset, adapter.reset):
        reset()
    action = np.zeros(environment.action_spec().shape)
    task, physics, random_state = environment.task, environment.physics, environment.random_state

    def hooks() -> None:
        task.before_step(physics, action, random_state)
        task.after_step(physics, random_state)
        task.get_reward(physics)
        task.should_terminate_episode(physics)

    measured = {
        "the task's hooks": hooks,
        "suite.load": lambda: environment.step(action),
        "Gymnasium adapter": lambda: adapter.step(action),
    }
    with mock.patch.object(mjcf.Physics, "step"):
        return {name: 1e6 * min(timeit.repeat(step, number=steps, repeat=9)) / steps for name, step in measured.items()}


def throughput(domain: Domain, environment: gymnasium.vector.VectorEnv, *, control_steps: int) -> float:
    """Control steps per second of a vectorised environment, over at least so many of them, all environments counted."""
    count = environment.num_envs
    actions = domain.draw(np.random.default_rng(0), (max(control_steps // count, 1), count))
    environment.reset(seed=0)
    environment.step(actions[0])
    start = time.perf_counter()
    for action in actions:
        environment.step(action)
    return actions.shape[0] * count / (time.perf_counter() - start)

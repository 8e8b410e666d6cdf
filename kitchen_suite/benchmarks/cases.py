"""What a benchmark measures: things that run an episode, by domain."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from dm_control import composer
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv

BARE = "bare mj_step"
SUITE = "suite.load, without visuals"
ADAPTER = "Gymnasium adapter, without visuals"
THREADS = (1, 2)

# Runs one episode with the given actions: (steps, n) of one environment, (steps, environments, n) of many.
Episode = Callable[[NDArray[np.float64]], None]
Builder = Callable[[int, int], gymnasium.vector.VectorEnv]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Contender:
    """Something that is measured.

    Attributes:
      episode: runs one episode.
      environments: how many it steps at once; 0 for one that is no vectorised environment.
      threads: on how many threads.
    """

    episode: Episode
    environments: int = 0
    threads: int = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Domain:
    """What is compared in a domain.

    Attributes:
      steps: control steps of an episode.
      draw: makes the actions of an episode, of a shape.
      contenders: makes all that is compared, by name, the vectorised ones with a number of environments; the first is
        what the others are measured against.
      comparisons: further ratios, by name: which contender's rate over which one's.
      own: builds the suite's environment, without a time limit, and an adapter over another one.
      builders: build vectorised environments of so many environments and threads, by name; the suite's own first.
    """

    steps: int
    draw: Callable[[np.random.Generator, tuple[int, ...]], NDArray[np.float64]]
    contenders: Callable[[int], dict[str, Contender]]
    comparisons: Callable[[int], dict[str, tuple[str, str]]]
    own: Callable[[], tuple[Environment, SuiteEnv]]
    builders: Mapping[str, Builder]


def vector_name(what: str, environments: int, threads: int) -> str:
    """Name of a vectorised contender."""
    return f"{what}, {environments} environments, {threads} {'thread' if threads == 1 else 'threads'}"


def dm_env_contender(environment: composer.Environment) -> Contender:
    """Steps an environment of dm_env's interface."""

    def episode(actions: NDArray[np.float64]) -> None:
        environment.reset()
        for action in actions:
            environment.step(action)

    return Contender(episode=episode)


def gymnasium_contender(environment: Any, environments: int = 0, threads: int = 1) -> Contender:
    """Steps an environment of Gymnasium's interface, or many at once."""

    def episode(actions: NDArray[np.float64]) -> None:
        environment.reset()
        for action in actions:
            environment.step(action)

    return Contender(episode=episode, environments=environments, threads=threads)


def vectorised_contenders(builders: Mapping[str, Builder], environments: int) -> dict[str, Contender]:
    """Everything that steps many environments, on each number of threads."""
    return {
        vector_name(what, environments, threads): gymnasium_contender(
            build(environments, threads), environments, threads
        )
        for threads in THREADS
        for what, build in builders.items()
    }

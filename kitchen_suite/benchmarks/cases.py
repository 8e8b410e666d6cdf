"""Benchmark cases: simulations and environments that run one episode with given actions."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv

# Names of cases that every domain has.
BARE = "bare mj_step"
SUITE = "suite.load, without visuals"
ADAPTER = "Gymnasium adapter, without visuals"

NUM_THREADS = (1, 2)

# Builds a vectorised environment of (num_envs, num_threads).
VectorEnvFactory = Callable[[int, int], gymnasium.vector.VectorEnv]
# Draws actions of a leading shape; the last axis is the action's.
DrawActions = Callable[[np.random.Generator, tuple[int, ...]], NDArray[np.float64]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Case:
    """A simulation or environment whose speed is measured.

    Attributes:
      episode: runs one episode with actions `(steps, n)`, or `(steps, num_envs, n)` if vectorised.
      num_envs: number of environments stepped together; 0 if not vectorised.
      num_threads: number of threads that step them.
    """

    episode: Callable[[NDArray[np.float64]], None]
    num_envs: int = 0
    num_threads: int = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchmarkDomain:
    """Cases of a domain and what they are compared by.

    Attributes:
      max_episode_steps: control steps of an episode.
      draw_actions: draws the actions of an episode.
      cases: builds the cases, by name, the vectorised ones with `num_envs` environments; the first is the denominator
        of every case's ratio.
      ratios: named ratios as (numerator case, denominator case), for `num_envs` environments.
      environments: builds the suite's environment and a Gymnasium environment, both without a time limit.
      vector_envs: name -> f(num_envs, num_threads); the suite's first.
      renderers: builds renderers of square images of `size` pixels, by name; the first is the denominator of every
        renderer's ratio.
    """

    max_episode_steps: int
    draw_actions: DrawActions
    cases: Callable[[int], dict[str, Case]]
    ratios: Callable[[int], dict[str, tuple[str, str]]]
    environments: Callable[[], tuple[Environment, SuiteEnv]]
    vector_envs: Mapping[str, VectorEnvFactory]
    renderers: Callable[[int], Mapping[str, MujocoRenderer]]


def environment_case(environment: Any, *, num_envs: int = 0, num_threads: int = 1) -> Case:
    """Returns the case of an environment with dm_env's or Gymnasium's interface."""

    def episode(actions: NDArray[np.float64]) -> None:
        environment.reset()
        for action in actions:
            environment.step(action)

    return Case(episode=episode, num_envs=num_envs, num_threads=num_threads)


def vector_case_name(name: str, num_envs: int, num_threads: int) -> str:
    """Returns the name of the case of a vectorised environment."""
    return f"{name}, {num_envs} environments, {num_threads} {'thread' if num_threads == 1 else 'threads'}"


def vector_cases(vector_envs: Mapping[str, VectorEnvFactory], num_envs: int) -> dict[str, Case]:
    """Builds the cases of vectorised environments, with each of `NUM_THREADS`."""
    return {
        vector_case_name(name, num_envs, num_threads): environment_case(
            build(num_envs, num_threads), num_envs=num_envs, num_threads=num_threads
        )
        for num_threads in NUM_THREADS
        for name, build in vector_envs.items()
    }

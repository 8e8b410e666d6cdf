"""Benchmark cases: simulations and environments that run one episode with given actions."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import abc
import dataclasses
import itertools
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self, cast

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks.rendering import suite_renderers
from kitchen_suite.domains.base import Domain
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv

# Names of cases that every domain has.
BARE = "bare mj_step"
SUITE = "suite.load, without visuals"
ADAPTER = "Gymnasium adapter, without visuals"

NUM_THREADS = (1, 2)

Control = Callable[[mujoco.MjData, NDArray[np.float64]], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Case:
    """A simulation or environment whose speed is measured.

    `episode` runs one episode with actions `(steps, n)`, or `(steps, num_envs, n)` if vectorised; else `num_envs` is 0.
    """

    episode: Callable[[NDArray[np.float64]], None]
    num_envs: int = 0
    num_threads: int = 1

    @classmethod
    def of(cls, environment: Any, **sizes: int) -> Self:
        """Returns the case of an environment with dm_env's or Gymnasium's interface; `sizes` are further fields."""

        def episode(actions: NDArray[np.float64]) -> None:
            environment.reset()
            for action in actions:
                environment.step(action)

        return cls(episode=episode, **sizes)

    @classmethod
    def bare(cls, model: mujoco.MjModel, qpos: NDArray[np.float64], substeps: int, control: Control) -> Self:
        """Returns the case of bare physics steps, with generalised positions `qpos` at the start.

        Each control step takes `substeps` physics steps, after `control` has set the controls for an action.
        """
        data = mujoco.MjData(model)

        def episode(actions: NDArray[np.float64]) -> None:
            mujoco.mj_resetData(model, data)
            data.qpos[:] = qpos
            for action in actions:
                control(data, action)
                mujoco.mj_step(model, data, substeps)

        return cls(episode=episode)


class BenchmarkDomain(abc.ABC):
    """Environments of a domain whose speed is measured, and what they are compared with.

    No episode terminates with the arguments `options`. Vectorised environments are measured by name with further
    arguments, `vector_options`.
    """

    domain: ClassVar[Domain]
    task_name: ClassVar[str]
    options: ClassVar[Mapping[str, Any]] = {}
    vector_options: ClassVar[Mapping[str, Mapping[str, Any]]] = {"vectorised": {}}

    @abc.abstractmethod
    def draw_actions(self, rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Draws actions `(*shape, n)` with which no episode terminates."""

    @abc.abstractmethod
    def bare_cases(self) -> dict[str, Case]:
        """Builds the cases of bare physics by name; the first is the denominator of every case's ratio."""

    @abc.abstractmethod
    def further_cases(self) -> dict[str, Case]:
        """Builds the cases by name that no other domain has."""

    def load(self, **options: Any) -> Environment:
        """Builds the suite's environment, without a time limit."""
        task_kwargs = {"random": 0, "time_limit": None, **self.options, **options}
        return suite.load(self.domain.name, self.task_name, task_kwargs)

    def adapter(self, **options: Any) -> SuiteEnv:
        """Builds the Gymnasium environment, without a time limit."""
        return cast(SuiteEnv, self.domain.env_class(**self.options, **options))

    @property
    def vector_names(self) -> tuple[str, ...]:
        """Names of the vectorised environments, the suite's first."""
        return tuple(self.vector_options)

    def vector_env(self, name: str, num_envs: int, num_threads: int) -> gymnasium.vector.VectorEnv:
        options = {**self.options, **self.vector_options[name]}
        build: Callable[..., gymnasium.vector.VectorEnv] = self.domain.vector_env_class
        return build(num_envs, num_threads=num_threads, max_episode_steps=self.domain.episode_steps, **options)

    def cases(self, num_envs: int) -> dict[str, Case]:
        """Builds all cases by name, the vectorised ones with `num_envs` environments."""
        vectorised = {}
        for threads, name in itertools.product(NUM_THREADS, self.vector_names):
            environments = self.vector_env(name, num_envs, threads)
            case = Case.of(environments, num_envs=num_envs, num_threads=threads)
            vectorised[vector_case_name(name, num_envs, threads)] = case
        return {
            **self.bare_cases(),
            SUITE: Case.of(self.load(visuals=False)),
            ADAPTER: Case.of(self.adapter()),
            "suite.load, with visuals": Case.of(self.load(visuals=True)),
            **self.further_cases(),
            **vectorised,
        }

    def ratios(self, num_envs: int) -> dict[str, tuple[str, str]]:
        """Returns named ratios as (numerator case, denominator case), for `num_envs` environments."""
        one, two = (vector_case_name("vectorised", num_envs, num_threads) for num_threads in NUM_THREADS)
        return {"Gymnasium adapter / suite.load": (ADAPTER, SUITE), "vectorised, two threads / one": (two, one)}

    def renderers(self, size: int) -> dict[str, MujocoRenderer]:
        """Builds renderers of square images of a size [pixels]; the first is the denominator of every ratio."""
        return suite_renderers(lambda quality: self.load(render_quality=quality), size)


def vector_case_name(name: str, num_envs: int, num_threads: int) -> str:
    """Returns the name of the case of a vectorised environment."""
    return f"{name}, {num_envs} environments, {num_threads} {'thread' if num_threads == 1 else 'threads'}"

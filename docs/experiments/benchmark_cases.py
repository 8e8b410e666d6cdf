"""Cases of the benchmarks: simulations and environments of each domain, which run one episode with given actions.

The kitchen is compared with Gymnasium-Robotics and, where it is installed, with EnvPool.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import abc
import dataclasses
import importlib.util
import itertools
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self, cast

import gymnasium
import mujoco
import numpy as np
from dm_control import composer, mjcf
from mujoco.batch import Batch
from numpy.typing import NDArray
from original import original_model, patched_kitchen_env

from kitchen_suite import suite
from kitchen_suite.domains.domain import Domain
from kitchen_suite.entities import OpenCabinetScene, build_kitchen_scene, build_open_cabinet_scene
from kitchen_suite.environment import INTEGRATION_STATE, Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.control_modes.joints import ACTION_SIZE, DEFAULT_POSE
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_TIMESTEP, PHYSICS_TIMESTEP, position_target
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS
from kitchen_suite.tasks.open_cabinet import mdp
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Names of cases that every domain has.
BARE = "bare mj_step"
SUITE = "suite.load, without visuals"
ADAPTER = "Gymnasium adapter, without visuals"

# Names of cases that the kitchen has.
ORIGINAL = "Gymnasium-Robotics, one helper replaced"
ENVPOOL = "EnvPool"
FAST_ADAPTER = "Gymnasium adapter, fast physics"

NUM_THREADS = (1, 2)

_KITCHEN_ACTION_SIZE = 9
_ARM = slice(7)

Control = Callable[[mujoco.MjData | Batch, NDArray[np.float64]], None]


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


class BareBatch:
    """The physics steps of vectorised environments alone, in MuJoCo's own batch of as many simulations."""

    def __init__(self, environments: SuiteVectorEnv, num_threads: int, control: Control) -> None:
        """Copies the model of environments that have been reset, and the state in which one of their episodes starts.

        Before the physics steps of a control step, `control` sets the controls for the actions.
        """
        physics = environments.template_env.environment.physics
        model, data = physics.model.ptr, physics.data.ptr
        self._start = np.empty(mujoco.mj_stateSize(model, INTEGRATION_STATE))
        mujoco.mj_getState(model, data, self._start, INTEGRATION_STATE)
        self._substeps = environments.composer_task.physics_steps_per_control_step
        self._batch = Batch(model, environments.num_envs, num_threads, persistent=True)
        self._control = control

    def reset(self) -> None:
        """Starts an episode in every simulation."""
        self._batch.state[:] = self._start

    def step(self, actions: NDArray[np.float64]) -> None:
        """Makes a control step with actions `(n, k)`."""
        self._control(self._batch, actions)
        self._batch.step(nstep=self._substeps)

    @property
    def states(self) -> NDArray[np.float64]:
        """State `(n, k)` of each simulation, an `INTEGRATION_STATE`; a live view."""
        states: NDArray[np.float64] = self._batch.state
        return states

    def close(self) -> None:
        """Frees the simulations and their threads."""
        del self._batch


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

    @staticmethod
    @abc.abstractmethod
    def control(data: mujoco.MjData | Batch, action: NDArray[np.float64]) -> None:
        """Sets the controls of one or many simulations for actions `(..., n)`, as the environments do without noise."""

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


def vector_case_name(name: str, num_envs: int, num_threads: int) -> str:
    """Returns the name of the case of a vectorised environment."""
    return f"{name}, {num_envs} environments, {num_threads} {'thread' if num_threads == 1 else 'threads'}"


class KitchenBenchmark(BenchmarkDomain):
    """The benchmark of the kitchen; no episode terminates."""

    domain = suite.DOMAINS["kitchen"]
    task_name = "all"
    options: ClassVar = {"terminate_on_tasks_completed": False}
    vector_options: ClassVar = {
        "vectorised": {},
        "vectorised, sleeping": {"sleep": True},
        "vectorised, fast physics": {"physics": "fast"},
    }

    def draw_actions(self, rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
        return rng.uniform(-1.0, 1.0, (*shape, _KITCHEN_ACTION_SIZE))

    @staticmethod
    def control(data: mujoco.MjData | Batch, action: NDArray[np.float64]) -> None:
        positions = data.qpos[..., :_KITCHEN_ACTION_SIZE]
        data.ctrl[:] = position_target(positions, action, velocity_scale=2.0, timestep=CONTROL_TIMESTEP)

    def bare_cases(self) -> dict[str, Case]:
        suite_model = mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=False).arena.mjcf_model).model.ptr
        return {
            name: Case.bare(model, INITIAL_QPOS, round(CONTROL_TIMESTEP / PHYSICS_TIMESTEP), self.control)
            for name, model in {BARE: original_model(), f"{BARE}, the suite's model": suite_model}.items()
        }

    def further_cases(self) -> dict[str, Case]:
        task = KitchenTask(build_kitchen_scene(), **self.options)
        settings: dict[str, Any] = {"strip_singleton_obs_buffer_dim": True, "recompile_mjcf_every_episode": False}
        return {
            "Gymnasium adapter, with visuals": Case.of(self.adapter(visuals=True)),
            FAST_ADAPTER: Case.of(self.adapter(physics="fast")),
            "the same task in stock composer": Case.of(composer.Environment(task, random_state=0, **settings)),
            ORIGINAL: self._original_case(),
        }

    def _original_case(self) -> Case:
        with patched_kitchen_env() as kitchen_env:
            case = Case.of(kitchen_env.KitchenEnv(**self.options))

        def episode(actions: NDArray[np.float64]) -> None:
            with patched_kitchen_env():
                case.episode(actions)

        return Case(episode=episode)

    @property
    def vector_names(self) -> tuple[str, ...]:
        return (*super().vector_names, ENVPOOL) if _has_envpool() else super().vector_names

    def vector_env(self, name: str, num_envs: int, num_threads: int) -> gymnasium.vector.VectorEnv:
        if name != ENVPOOL:
            return super().vector_env(name, num_envs, num_threads)
        import envpool

        sizes = {"num_envs": num_envs, "num_threads": num_threads}
        return cast(gymnasium.vector.VectorEnv, envpool.make_gymnasium("FrankaKitchen-v1", **sizes, **self.options))

    def ratios(self, num_envs: int) -> dict[str, tuple[str, str]]:
        names = (*self.vector_options, ENVPOOL)
        ours, sleeping, fast, envpool = (vector_case_name(name, num_envs, 1) for name in names)
        named = {
            **super().ratios(num_envs),
            "vectorised, one thread / Gymnasium-Robotics": (ours, ORIGINAL),
            "fast physics / exact, Gymnasium adapter": (FAST_ADAPTER, ADAPTER),
            "fast physics / exact, vectorised, one thread": (fast, ours),
        }
        if _has_envpool():
            named |= {
                "vectorised / EnvPool, one thread each": (ours, envpool),
                "vectorised, sleeping / EnvPool, one thread each": (sleeping, envpool),
                "vectorised, fast physics / EnvPool, one thread each": (fast, envpool),
                "EnvPool, two threads / one": (vector_case_name(ENVPOOL, num_envs, 2), envpool),
            }
        return named


def _has_envpool() -> bool:
    return importlib.util.find_spec("envpool") is not None


class EmptyTask(composer.Task):
    """A task without observations or rewards, which only sets controls; its speed is that of composer itself."""

    def __init__(self, scene: OpenCabinetScene) -> None:
        self._scene = scene
        self.set_timesteps(control_timestep=mdp.CONTROL_TIMESTEP, physics_timestep=mdp.PHYSICS_TIMESTEP)

    @property
    def root_entity(self) -> composer.Entity:
        return self._scene.arena

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._ctrl, self._qpos = physics.data.ctrl, physics.data.qpos
        self._qpos[: DEFAULT_POSE.size] = DEFAULT_POSE

    def before_step(self, physics: mjcf.Physics, action: NDArray, random_state: np.random.RandomState) -> None:
        self._ctrl[_ARM] = self._qpos[_ARM] + action[_ARM]

    def get_reward(self, physics: mjcf.Physics) -> float:
        return 0.0


class OpenCabinetBenchmark(BenchmarkDomain):
    """The benchmark of open_cabinet."""

    domain = suite.DOMAINS["open_cabinet"]
    task_name = "top_drawer"

    def draw_actions(self, rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
        # Joint offsets so small that the episode does not terminate.
        return rng.normal(0.0, 0.01, (*shape, ACTION_SIZE))

    @staticmethod
    def control(data: mujoco.MjData | Batch, action: NDArray[np.float64]) -> None:
        data.ctrl[..., _ARM] = data.qpos[..., _ARM] + action[..., _ARM]

    def bare_cases(self) -> dict[str, Case]:
        environment = self.load(visuals=False)
        environment.reset()
        physics = environment.physics
        substeps = round(mdp.CONTROL_TIMESTEP / mdp.PHYSICS_TIMESTEP)
        return {BARE: Case.bare(physics.model.ptr, physics.data.qpos.copy(), substeps, self.control)}

    def further_cases(self) -> dict[str, Case]:
        task = EmptyTask(build_open_cabinet_scene(visuals=False))
        environment = composer.Environment(task, recompile_mjcf_every_episode=False)
        return {"a task without observations or rewards": Case.of(environment)}


DOMAINS: Mapping[str, BenchmarkDomain] = {"kitchen": KitchenBenchmark(), "open_cabinet": OpenCabinetBenchmark()}

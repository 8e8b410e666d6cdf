"""What `kitchen-benchmark` compares, domain by domain."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import gymnasium
import mujoco
import numpy as np
from dm_control import composer
from numpy.typing import NDArray

from kitchen_suite import benchmark_peers as peers
from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen
from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaOpenCabinetEnv
from kitchen_suite.tasks import KitchenTask, drawer_rules, kitchen_rules
from kitchen_suite.tasks.drawer_control import JOINT_LOW
from kitchen_suite.tasks.kitchen_start import INITIAL_QPOS
from kitchen_suite.tasks.velocity_control import position_target
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

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
      builders: build vectorised environments of so many environments and threads, by name; the suite's own first.
    """

    steps: int
    draw: Callable[[np.random.Generator, tuple[int, ...]], NDArray[np.float64]]
    contenders: Callable[[int], dict[str, Contender]]
    comparisons: Callable[[int], dict[str, tuple[str, str]]]
    builders: Mapping[str, Builder]


def vector_name(what: str, environments: int, threads: int) -> str:
    """Name of a vectorised contender."""
    return f"{what}, {environments} environments, {threads} {'thread' if threads == 1 else 'threads'}"


def bare_kitchen() -> Contender:
    """Bare physics steps of the original's model, controls computed as the task does."""
    model = peers.original_model()
    data = mujoco.MjData(model)
    timestep = kitchen_rules.CONTROL_TIMESTEP
    substeps = round(timestep / kitchen_rules.PHYSICS_TIMESTEP)

    def episode(actions: NDArray[np.float64]) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = INITIAL_QPOS
        for action in actions:
            data.ctrl[:] = position_target(data.qpos[:9], action, velocity_scale=2.0, timestep=timestep)
            mujoco.mj_step(model, data, substeps)

    return Contender(episode=episode)


def bare_cabinet() -> Contender:
    """Bare physics steps of the suite's own model of the cabinet, the arm's servos following the actions."""
    environment = suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False})
    environment.reset()
    model, data = environment.physics.model.ptr, mujoco.MjData(environment.physics.model.ptr)
    start = environment.physics.data.qpos.copy()
    substeps = round(drawer_rules.CONTROL_TIMESTEP / drawer_rules.PHYSICS_TIMESTEP)

    def episode(actions: NDArray[np.float64]) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start
        for action in actions:
            data.ctrl[:7] = data.qpos[:7] + action[:7]
            mujoco.mj_step(model, data, substeps)

    return Contender(episode=episode)


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


def original_contender() -> Contender:
    """Steps Gymnasium-Robotics' own environment."""
    with peers.helper_replaced() as kitchen_env:
        steps = gymnasium_contender(kitchen_env.KitchenEnv(terminate_on_tasks_completed=False))

    def episode(actions: NDArray[np.float64]) -> None:
        with peers.helper_replaced():
            steps.episode(actions)

    return Contender(episode=episode)


def vectorised_kitchen(environments: int, threads: int, **settings: Any) -> FrankaKitchenVectorEnv:
    """The suite's vectorised kitchen; its episodes do not terminate."""
    settings |= {"max_episode_steps": 280, "terminate_on_tasks_completed": False}
    return FrankaKitchenVectorEnv(environments, num_threads=threads, **settings)


def vectorised_cabinet(environments: int, threads: int) -> FrankaOpenCabinetVectorEnv:
    """The suite's vectorised cabinet."""
    return FrankaOpenCabinetVectorEnv(environments, num_threads=threads, max_episode_steps=700)


CABINET_BUILDERS: Mapping[str, Builder] = MappingProxyType({"vectorised": vectorised_cabinet})


def kitchen_builders() -> dict[str, Builder]:
    """The suite's vectorised kitchens, and EnvPool's where it is installed."""
    builders: dict[str, Builder] = {
        "vectorised": vectorised_kitchen,
        "vectorised, sleeping": functools.partial(vectorised_kitchen, sleep=True),
    }
    return builders | ({"EnvPool": peers.envpool_kitchen} if peers.has_envpool() else {})


def _vectorised_contenders(builders: Mapping[str, Builder], environments: int) -> dict[str, Contender]:
    """Everything that steps many environments, on each number of threads."""
    return {
        vector_name(what, environments, threads): gymnasium_contender(
            build(environments, threads), environments, threads
        )
        for threads in THREADS
        for what, build in builders.items()
    }


def kitchen_contenders(environments: int) -> dict[str, Contender]:
    """Bare MuJoCo on the original's model, the suite in all its forms, and its peers."""
    quiet = {"random": 0, "terminate_on_tasks_completed": False, "time_limit": None}
    task = KitchenTask(build_kitchen(), terminate_on_tasks_completed=False)
    stock = composer.Environment(
        task, random_state=0, strip_singleton_obs_buffer_dim=True, recompile_mjcf_every_episode=False
    )
    contenders: dict[str, Contender] = {
        BARE: bare_kitchen(),
        SUITE: dm_env_contender(suite.load("kitchen", "all", {**quiet, "visuals": False})),
        ADAPTER: gymnasium_contender(FrankaKitchenEnv(terminate_on_tasks_completed=False)),
        "suite.load, with visuals": dm_env_contender(suite.load("kitchen", "all", quiet)),
        "Gymnasium adapter, with visuals": gymnasium_contender(
            FrankaKitchenEnv(terminate_on_tasks_completed=False, visuals=True)
        ),
        "the same task in stock composer": dm_env_contender(stock),
        "Gymnasium-Robotics, one helper replaced": original_contender(),
    }
    return contenders | _vectorised_contenders(kitchen_builders(), environments)


def kitchen_comparisons(environments: int) -> dict[str, tuple[str, str]]:
    """What the adapter costs, what a second thread brings, and the peers."""

    def name(what: str, threads: int = 1) -> str:
        return vector_name(what, environments, threads)

    comparisons = {
        "Gymnasium adapter / suite.load": (ADAPTER, SUITE),
        "vectorised, two threads / one": (name("vectorised", 2), name("vectorised")),
        "vectorised, one thread / Gymnasium-Robotics": (name("vectorised"), "Gymnasium-Robotics, one helper replaced"),
    }
    if peers.has_envpool():
        comparisons |= {
            "vectorised / EnvPool, one thread each": (name("vectorised"), name("EnvPool")),
            "vectorised, sleeping / EnvPool, one thread each": (name("vectorised, sleeping"), name("EnvPool")),
            "EnvPool, two threads / one": (name("EnvPool", 2), name("EnvPool")),
        }
    return comparisons


def cabinet_contenders(environments: int) -> dict[str, Contender]:
    """Bare MuJoCo on the suite's own model, and the suite."""
    quiet = {"random": 0, "time_limit": None}
    contenders = {
        BARE: bare_cabinet(),
        SUITE: dm_env_contender(suite.load("open_cabinet", "top_drawer", {**quiet, "visuals": False})),
        ADAPTER: gymnasium_contender(FrankaOpenCabinetEnv()),
        "suite.load, with visuals": dm_env_contender(suite.load("open_cabinet", "top_drawer", quiet)),
    }
    return contenders | _vectorised_contenders(CABINET_BUILDERS, environments)


def cabinet_comparisons(environments: int) -> dict[str, tuple[str, str]]:
    """What the adapter costs, and what a second thread brings."""
    one, two = (vector_name("vectorised", environments, threads) for threads in THREADS)
    return {"Gymnasium adapter / suite.load": (ADAPTER, SUITE), "vectorised, two threads / one": (two, one)}


DOMAINS: Mapping[str, Domain] = MappingProxyType(
    {
        "kitchen": Domain(
            steps=280,
            draw=lambda rng, shape: rng.uniform(-1.0, 1.0, (*shape, 9)),
            contenders=kitchen_contenders,
            comparisons=kitchen_comparisons,
            builders=kitchen_builders(),
        ),
        # Offsets so small that the episode does not terminate.
        "open_cabinet": Domain(
            steps=700,
            draw=lambda rng, shape: rng.normal(0.0, 0.01, (*shape, JOINT_LOW.size)),
            contenders=cabinet_contenders,
            comparisons=cabinet_comparisons,
            builders=CABINET_BUILDERS,
        ),
    }
)

"""What `kitchen-benchmark` compares in the kitchen."""

import functools
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks import baselines as peers
from kitchen_suite.benchmarks.cases import (
    ADAPTER,
    BARE,
    SUITE,
    Builder,
    Contender,
    Domain,
    dm_env_contender,
    gymnasium_contender,
    vector_name,
    vectorised_contenders,
)
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen import mdp as kitchen_rules
from kitchen_suite.tasks.kitchen.action import position_target
from kitchen_suite.tasks.kitchen.initial_state import INITIAL_QPOS
from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv

ORIGINAL = "Gymnasium-Robotics, one helper replaced"


def bare_kitchen(model: mujoco.MjModel) -> Contender:
    """Bare physics steps of a model, controls computed as the task does."""
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


def builders() -> dict[str, Builder]:
    """The suite's vectorised kitchens, and EnvPool's where it is installed."""
    known: dict[str, Builder] = {
        "vectorised": vectorised_kitchen,
        "vectorised, sleeping": functools.partial(vectorised_kitchen, sleep=True),
    }
    return known | ({"EnvPool": peers.envpool_kitchen} if peers.has_envpool() else {})


def own() -> tuple[Environment, FrankaKitchenEnv]:
    """The suite's own environment and adapter, without visuals; their episodes do not terminate."""
    quiet = {"random": 0, "terminate_on_tasks_completed": False, "time_limit": None, "visuals": False}
    return suite.load("kitchen", "all", quiet), FrankaKitchenEnv(terminate_on_tasks_completed=False)


def contenders(environments: int) -> dict[str, Contender]:
    """Bare MuJoCo on the original's model, the suite in all its forms, and its peers."""
    quiet = {"random": 0, "terminate_on_tasks_completed": False, "time_limit": None}
    environment, adapter = own()
    own_model = mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=False).arena.mjcf_model).model.ptr
    task = KitchenTask(build_kitchen_scene(), terminate_on_tasks_completed=False)
    stock = composer.Environment(
        task, random_state=0, strip_singleton_obs_buffer_dim=True, recompile_mjcf_every_episode=False
    )
    measured: dict[str, Contender] = {
        BARE: bare_kitchen(peers.original_model()),
        "bare mj_step, the suite's model": bare_kitchen(own_model),
        SUITE: dm_env_contender(environment),
        ADAPTER: gymnasium_contender(adapter),
        "suite.load, with visuals": dm_env_contender(suite.load("kitchen", "all", quiet)),
        "Gymnasium adapter, with visuals": gymnasium_contender(
            FrankaKitchenEnv(terminate_on_tasks_completed=False, visuals=True)
        ),
        "the same task in stock composer": dm_env_contender(stock),
        ORIGINAL: original_contender(),
    }
    return measured | vectorised_contenders(builders(), environments)


def comparisons(environments: int) -> dict[str, tuple[str, str]]:
    """What the adapter costs, what a second thread brings, and the peers."""

    def name(what: str, threads: int = 1) -> str:
        return vector_name(what, environments, threads)

    ratios = {
        "Gymnasium adapter / suite.load": (ADAPTER, SUITE),
        "vectorised, two threads / one": (name("vectorised", 2), name("vectorised")),
        "vectorised, one thread / Gymnasium-Robotics": (name("vectorised"), ORIGINAL),
    }
    if peers.has_envpool():
        ratios |= {
            "vectorised / EnvPool, one thread each": (name("vectorised"), name("EnvPool")),
            "vectorised, sleeping / EnvPool, one thread each": (name("vectorised, sleeping"), name("EnvPool")),
            "EnvPool, two threads / one": (name("EnvPool", 2), name("EnvPool")),
        }
    return ratios


KITCHEN = Domain(
    steps=280,
    draw=lambda rng, shape: rng.uniform(-1.0, 1.0, (*shape, 9)),
    contenders=contenders,
    comparisons=comparisons,
    own=own,
    builders=builders(),
)

"""Benchmark cases of the kitchen; none of their episodes terminates."""

import functools
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks import baselines
from kitchen_suite.benchmarks.cases import (
    ADAPTER,
    BARE,
    SUITE,
    BenchmarkDomain,
    Case,
    VectorEnvFactory,
    environment_case,
    vector_case_name,
    vector_cases,
)
from kitchen_suite.benchmarks.rendering import suite_renderers
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.kitchen import FrankaKitchenEnv
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen.action import CONTROL_TIMESTEP, PHYSICS_TIMESTEP, position_target
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS
from kitchen_suite.vector_env.kitchen import FrankaKitchenVectorEnv

ORIGINAL = "Gymnasium-Robotics, one helper replaced"

_ACTION_SIZE = 9
_MAX_EPISODE_STEPS = suite.DOMAINS["kitchen"].episode_steps


def draw_actions(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Draws uniform actions `(*shape, 9)`."""
    return rng.uniform(-1.0, 1.0, (*shape, _ACTION_SIZE))


def load(**options: Any) -> Environment:
    """Builds the suite's environment, without a time limit."""
    task_kwargs = {"random": 0, "terminate_on_tasks_completed": False, "time_limit": None, **options}
    return suite.load("kitchen", "all", task_kwargs)


def environments() -> tuple[Environment, FrankaKitchenEnv]:
    """Builds the suite's environment and a Gymnasium environment, without visuals or a time limit."""
    return load(visuals=False), FrankaKitchenEnv(terminate_on_tasks_completed=False)


def vectorised_kitchen(num_envs: int, num_threads: int, *, sleep: bool = False) -> FrankaKitchenVectorEnv:
    """Builds the suite's vectorised environment."""
    return FrankaKitchenVectorEnv(
        num_envs,
        num_threads=num_threads,
        max_episode_steps=_MAX_EPISODE_STEPS,
        terminate_on_tasks_completed=False,
        sleep=sleep,
    )


VECTOR_ENVS: dict[str, VectorEnvFactory] = {
    "vectorised": vectorised_kitchen,
    "vectorised, sleeping": functools.partial(vectorised_kitchen, sleep=True),
}
if baselines.has_envpool():
    VECTOR_ENVS["EnvPool"] = baselines.envpool_kitchen


def bare_case(model: mujoco.MjModel) -> Case:
    """Returns the case of bare physics steps of a model, with controls computed as the task does."""
    data = mujoco.MjData(model)
    substeps = round(CONTROL_TIMESTEP / PHYSICS_TIMESTEP)

    def episode(actions: NDArray[np.float64]) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = INITIAL_QPOS
        for action in actions:
            positions = data.qpos[:_ACTION_SIZE]
            data.ctrl[:] = position_target(positions, action, velocity_scale=2.0, timestep=CONTROL_TIMESTEP)
            mujoco.mj_step(model, data, substeps)

    return Case(episode=episode)


def original_case() -> Case:
    """Builds the case of Gymnasium-Robotics' environment."""
    with baselines.patched_kitchen_env() as kitchen_env:
        case = environment_case(kitchen_env.KitchenEnv(terminate_on_tasks_completed=False))

    def episode(actions: NDArray[np.float64]) -> None:
        with baselines.patched_kitchen_env():
            case.episode(actions)

    return Case(episode=episode)


def stock_composer_case() -> Case:
    """Builds the case of the suite's task in composer's own environment."""
    task = KitchenTask(build_kitchen_scene(), terminate_on_tasks_completed=False)
    settings: dict[str, Any] = {"strip_singleton_obs_buffer_dim": True, "recompile_mjcf_every_episode": False}
    return environment_case(composer.Environment(task, random_state=0, **settings))


def cases(num_envs: int) -> dict[str, Case]:
    """Builds the cases: bare MuJoCo on the original's model, the suite in all its forms, and the baselines."""
    environment, adapter = environments()
    suite_model = mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=False).arena.mjcf_model).model.ptr
    adapter_with_visuals = FrankaKitchenEnv(terminate_on_tasks_completed=False, visuals=True)
    return {
        BARE: bare_case(baselines.original_model()),
        "bare mj_step, the suite's model": bare_case(suite_model),
        SUITE: environment_case(environment),
        ADAPTER: environment_case(adapter),
        "suite.load, with visuals": environment_case(load(visuals=True)),
        "Gymnasium adapter, with visuals": environment_case(adapter_with_visuals),
        "the same task in stock composer": stock_composer_case(),
        ORIGINAL: original_case(),
        **vector_cases(VECTOR_ENVS, num_envs),
    }


def ratios(num_envs: int) -> dict[str, tuple[str, str]]:
    """Returns named ratios as (numerator case, denominator case)."""

    def name(vector_env: str, num_threads: int) -> str:
        return vector_case_name(vector_env, num_envs, num_threads)

    named = {
        "Gymnasium adapter / suite.load": (ADAPTER, SUITE),
        "vectorised, two threads / one": (name("vectorised", 2), name("vectorised", 1)),
        "vectorised, one thread / Gymnasium-Robotics": (name("vectorised", 1), ORIGINAL),
    }
    if baselines.has_envpool():
        envpool = name("EnvPool", 1)
        named |= {
            "vectorised / EnvPool, one thread each": (name("vectorised", 1), envpool),
            "vectorised, sleeping / EnvPool, one thread each": (name("vectorised, sleeping", 1), envpool),
            "EnvPool, two threads / one": (name("EnvPool", 2), envpool),
        }
    return named


def renderers(size: int) -> dict[str, MujocoRenderer]:
    """Builds Gymnasium-Robotics' own renderer, with its default camera, and those of the suite's environment."""
    with baselines.patched_kitchen_env() as kitchen_env:
        original = kitchen_env.KitchenEnv(render_mode="rgb_array", width=size, height=size)
        original.reset(seed=0)
    suite_own = suite_renderers(lambda quality: load(render_quality=quality), size)
    return {"Gymnasium-Robotics": original.robot_env.mujoco_renderer, **suite_own}


KITCHEN = BenchmarkDomain(
    max_episode_steps=_MAX_EPISODE_STEPS,
    draw_actions=draw_actions,
    cases=cases,
    ratios=ratios,
    environments=environments,
    vector_envs=VECTOR_ENVS,
    renderers=renderers,
)

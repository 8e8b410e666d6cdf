"""Benchmark cases of open_cabinet."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks.cases import (
    ADAPTER,
    BARE,
    NUM_THREADS,
    SUITE,
    BenchmarkDomain,
    Case,
    VectorEnvFactory,
    environment_case,
    vector_case_name,
    vector_cases,
)
from kitchen_suite.benchmarks.rendering import suite_renderers
from kitchen_suite.entities import OpenCabinetScene, build_open_cabinet_scene
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.cabinets import FrankaOpenCabinetEnv
from kitchen_suite.tasks.control_modes.joints import ACTION_SIZE, DEFAULT_POSE
from kitchen_suite.tasks.open_cabinet import mdp
from kitchen_suite.vector_env.cabinets import FrankaOpenCabinetVectorEnv

_MAX_EPISODE_STEPS = suite.DOMAINS["open_cabinet"].episode_steps
_ARM = slice(7)


def draw_actions(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Draws actions `(*shape, 8)` with joint offsets so small that the episode does not terminate."""
    return rng.normal(0.0, 0.01, (*shape, ACTION_SIZE))


def load(**options: Any) -> Environment:
    """Builds the suite's environment, without a time limit."""
    return suite.load("open_cabinet", "top_drawer", {"random": 0, "time_limit": None, **options})


def environments() -> tuple[Environment, FrankaOpenCabinetEnv]:
    """Builds the suite's environment and a Gymnasium environment, without visuals or a time limit."""
    return load(visuals=False), FrankaOpenCabinetEnv()


def vectorised_open_cabinet(num_envs: int, num_threads: int) -> FrankaOpenCabinetVectorEnv:
    """Builds the suite's vectorised environment."""
    return FrankaOpenCabinetVectorEnv(num_envs, num_threads=num_threads, max_episode_steps=_MAX_EPISODE_STEPS)


VECTOR_ENVS: Mapping[str, VectorEnvFactory] = {"vectorised": vectorised_open_cabinet}


def bare_case() -> Case:
    """Builds the case of bare physics steps of the suite's model, with joint offsets as the arm's controls."""
    environment = load(visuals=False)
    environment.reset()
    model, data = environment.physics.model.ptr, mujoco.MjData(environment.physics.model.ptr)
    initial_qpos = environment.physics.data.qpos.copy()
    substeps = round(mdp.CONTROL_TIMESTEP / mdp.PHYSICS_TIMESTEP)

    def episode(actions: NDArray[np.float64]) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = initial_qpos
        for action in actions:
            data.ctrl[_ARM] = data.qpos[_ARM] + action[_ARM]
            mujoco.mj_step(model, data, substeps)

    return Case(episode=episode)


class EmptyTask(composer.Task):
    """A task without observations or rewards, which only sets controls; its speed is that of composer itself."""

    def __init__(self, scene: OpenCabinetScene) -> None:
        """Sets the task up in a scene."""
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


def empty_task_case() -> Case:
    """Builds the case of `EmptyTask` in composer's own environment."""
    task = EmptyTask(build_open_cabinet_scene(visuals=False))
    return environment_case(composer.Environment(task, recompile_mjcf_every_episode=False))


def cases(num_envs: int) -> dict[str, Case]:
    """Builds the cases: bare MuJoCo on the suite's own model, the suite in all its forms, and composer itself."""
    environment, adapter = environments()
    return {
        BARE: bare_case(),
        SUITE: environment_case(environment),
        ADAPTER: environment_case(adapter),
        "suite.load, with visuals": environment_case(load(visuals=True)),
        "a task without observations or rewards": empty_task_case(),
        **vector_cases(VECTOR_ENVS, num_envs),
    }


def ratios(num_envs: int) -> dict[str, tuple[str, str]]:
    """Returns named ratios as (numerator case, denominator case)."""
    one, two = (vector_case_name("vectorised", num_envs, num_threads) for num_threads in NUM_THREADS)
    return {"Gymnasium adapter / suite.load": (ADAPTER, SUITE), "vectorised, two threads / one": (two, one)}


def renderers(size: int) -> dict[str, MujocoRenderer]:
    """Builds the renderers of the suite's environment."""
    return suite_renderers(lambda quality: load(render_quality=quality), size)


OPEN_CABINET = BenchmarkDomain(
    max_episode_steps=_MAX_EPISODE_STEPS,
    draw_actions=draw_actions,
    cases=cases,
    ratios=ratios,
    environments=environments,
    vector_envs=VECTOR_ENVS,
    renderers=renderers,
)

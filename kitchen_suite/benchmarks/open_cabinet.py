"""What `kitchen-benchmark` compares before the cabinet."""

from collections.abc import Mapping
from types import MappingProxyType

import mujoco
import numpy as np
from dm_control import composer, mjcf
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks.cases import (
    ADAPTER,
    BARE,
    SUITE,
    THREADS,
    Builder,
    Contender,
    Domain,
    dm_env_contender,
    gymnasium_contender,
    vector_name,
    vectorised_contenders,
)
from kitchen_suite.entities import OpenCabinetScene, build_open_cabinet_scene
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv
from kitchen_suite.tasks.open_cabinet import mdp as drawer_rules
from kitchen_suite.tasks.open_cabinet import task as open_cabinet
from kitchen_suite.vector_env.open_cabinet import FrankaOpenCabinetVectorEnv


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


class EmptyTask(composer.Task):
    """What composer itself costs: a task that observes nothing and pays nothing, and only sets the servos' targets."""

    def __init__(self, scene: OpenCabinetScene) -> None:
        """Sets the task up in a scene."""
        self._scene = scene
        self.set_timesteps(
            control_timestep=drawer_rules.CONTROL_TIMESTEP, physics_timestep=drawer_rules.PHYSICS_TIMESTEP
        )

    @property
    def root_entity(self) -> composer.Entity:
        return self._scene.arena

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        del random_state
        self._ctrl, self._qpos = physics.data.ctrl, physics.data.qpos
        self._qpos[: open_cabinet.DEFAULT_POSE.size] = open_cabinet.DEFAULT_POSE

    def before_step(self, physics: mjcf.Physics, action: NDArray, random_state: np.random.RandomState) -> None:
        del physics, random_state
        self._ctrl[:7] = self._qpos[:7] + action[:7]

    def get_reward(self, physics: mjcf.Physics) -> float:
        del physics
        return 0.0


def vectorised_cabinet(environments: int, threads: int) -> FrankaOpenCabinetVectorEnv:
    """The suite's vectorised cabinet."""
    return FrankaOpenCabinetVectorEnv(environments, num_threads=threads, max_episode_steps=700)


BUILDERS: Mapping[str, Builder] = MappingProxyType({"vectorised": vectorised_cabinet})


def own() -> tuple[Environment, FrankaOpenCabinetEnv]:
    """The suite's own environment and adapter, without visuals."""
    quiet = {"random": 0, "time_limit": None, "visuals": False}
    return suite.load("open_cabinet", "top_drawer", quiet), FrankaOpenCabinetEnv()


def contenders(environments: int) -> dict[str, Contender]:
    """Bare MuJoCo on the suite's own model, and the suite."""
    environment, adapter = own()
    quiet = {"random": 0, "time_limit": None}
    measured = {
        BARE: bare_cabinet(),
        SUITE: dm_env_contender(environment),
        ADAPTER: gymnasium_contender(adapter),
        "suite.load, with visuals": dm_env_contender(suite.load("open_cabinet", "top_drawer", quiet)),
        "a task without observations or rewards": dm_env_contender(
            composer.Environment(EmptyTask(build_open_cabinet_scene(visuals=False)), recompile_mjcf_every_episode=False)
        ),
    }
    return measured | vectorised_contenders(BUILDERS, environments)


def comparisons(environments: int) -> dict[str, tuple[str, str]]:
    """What the adapter costs, and what a second thread brings."""
    one, two = (vector_name("vectorised", environments, threads) for threads in THREADS)
    return {"Gymnasium adapter / suite.load": (ADAPTER, SUITE), "vectorised, two threads / one": (two, one)}


CABINET = Domain(
    steps=700,
    # Offsets so small that the episode does not terminate.
    draw=lambda rng, shape: rng.normal(0.0, 0.01, (*shape, drawer_rules.ACTION_SIZE)),
    contenders=contenders,
    comparisons=comparisons,
    own=own,
    builders=BUILDERS,
)

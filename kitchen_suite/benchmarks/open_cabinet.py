"""Benchmark cases of open_cabinet."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import mujoco
import numpy as np
from dm_control import composer, mjcf
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks.cases import BARE, BenchmarkDomain, Case
from kitchen_suite.entities import OpenCabinetScene, build_open_cabinet_scene
from kitchen_suite.tasks.control_modes.joints import ACTION_SIZE, DEFAULT_POSE
from kitchen_suite.tasks.open_cabinet import mdp

_ARM = slice(7)


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

    def bare_cases(self) -> dict[str, Case]:
        environment = self.load(visuals=False)
        environment.reset()
        physics, substeps = environment.physics, round(mdp.CONTROL_TIMESTEP / mdp.PHYSICS_TIMESTEP)
        return {BARE: Case.bare(physics.model.ptr, physics.data.qpos.copy(), substeps, _control)}

    def further_cases(self) -> dict[str, Case]:
        task = EmptyTask(build_open_cabinet_scene(visuals=False))
        environment = composer.Environment(task, recompile_mjcf_every_episode=False)
        return {"a task without observations or rewards": Case.of(environment)}


def _control(data: mujoco.MjData, action: NDArray[np.float64]) -> None:
    data.ctrl[_ARM] = data.qpos[_ARM] + action[_ARM]


OPEN_CABINET = OpenCabinetBenchmark()

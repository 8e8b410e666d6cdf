"""Benchmark cases of the kitchen, of Gymnasium-Robotics and, where installed, EnvPool; no episode terminates."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import importlib.util
import warnings
from collections.abc import Iterator
from typing import Any, ClassVar, cast
from unittest import mock

import gymnasium
import mujoco
import numpy as np
from dm_control import composer, mjcf
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.benchmarks.cases import ADAPTER, BARE, BenchmarkDomain, Case, vector_case_name
from kitchen_suite.entities import assets, build_kitchen_scene
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.kitchen.action import CONTROL_TIMESTEP, PHYSICS_TIMESTEP, position_target
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS

ORIGINAL = "Gymnasium-Robotics, one helper replaced"
ENVPOOL = "EnvPool"
_FAST_ADAPTER = "Gymnasium adapter, fast physics"

_ACTION_SIZE = 9


def original_model() -> mujoco.MjModel:
    """Compiles the model of FrankaKitchen-v1."""
    return mujoco.MjModel.from_xml_path(str(assets.asset_dir() / "kitchen_assets" / "kitchen_env_model.xml"))


@contextlib.contextmanager
def patched_kitchen_env() -> Iterator[Any]:
    """Yields Gymnasium-Robotics' module `kitchen_env`, with the one helper replaced that fails since MuJoCo 3.12."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from gymnasium_robotics.envs.franka_kitchen import franka_env, kitchen_env

    with mock.patch.object(franka_env, "robot_get_obs", _robot_get_obs):
        yield kitchen_env


def _robot_get_obs(model: Any, data: Any, names: Any) -> tuple[NDArray, NDArray]:
    """Returns the robot's joint positions (9,) and velocities (9,), as the helper did."""
    return data.qpos[:9].copy(), data.qvel[:9].copy()


def _has_envpool() -> bool:
    return importlib.util.find_spec("envpool") is not None


class KitchenBenchmark(BenchmarkDomain):
    """The benchmark of the kitchen."""

    domain = suite.DOMAINS["kitchen"]
    task_name = "all"
    options: ClassVar = {"terminate_on_tasks_completed": False}
    vector_options: ClassVar = {
        "vectorised": {},
        "vectorised, sleeping": {"sleep": True},
        "vectorised, fast physics": {"physics": "fast"},
    }

    def draw_actions(self, rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
        return rng.uniform(-1.0, 1.0, (*shape, _ACTION_SIZE))

    def bare_cases(self) -> dict[str, Case]:
        suite_model = mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=False).arena.mjcf_model).model.ptr
        return {
            name: Case.bare(model, INITIAL_QPOS, round(CONTROL_TIMESTEP / PHYSICS_TIMESTEP), _control)
            for name, model in {BARE: original_model(), f"{BARE}, the suite's model": suite_model}.items()
        }

    def further_cases(self) -> dict[str, Case]:
        task = KitchenTask(build_kitchen_scene(), **self.options)
        settings: dict[str, Any] = {"strip_singleton_obs_buffer_dim": True, "recompile_mjcf_every_episode": False}
        return {
            "Gymnasium adapter, with visuals": Case.of(self.adapter(visuals=True)),
            _FAST_ADAPTER: Case.of(self.adapter(physics="fast")),
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
            "fast physics / exact, Gymnasium adapter": (_FAST_ADAPTER, ADAPTER),
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

    def renderers(self, size: int) -> dict[str, MujocoRenderer]:
        with patched_kitchen_env() as kitchen_env:
            original = kitchen_env.KitchenEnv(render_mode="rgb_array", width=size, height=size)
            original.reset(seed=0)
        return {"Gymnasium-Robotics": original.robot_env.mujoco_renderer, **super().renderers(size)}


def _control(data: mujoco.MjData, action: NDArray[np.float64]) -> None:
    positions = data.qpos[:_ACTION_SIZE]
    data.ctrl[:] = position_target(positions, action, velocity_scale=2.0, timestep=CONTROL_TIMESTEP)


KITCHEN = KitchenBenchmark()

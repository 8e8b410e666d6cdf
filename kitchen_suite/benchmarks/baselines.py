"""FrankaKitchen-v1 by others: Gymnasium-Robotics' own and, where installed, EnvPool's."""

import contextlib
import importlib.util
import warnings
from collections.abc import Iterator
from typing import Any
from unittest import mock

import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities import assets


def original_model() -> mujoco.MjModel:
    """The model of FrankaKitchen-v1."""
    return mujoco.MjModel.from_xml_path(str(assets.asset_dir() / "kitchen_assets" / "kitchen_env_model.xml"))


@contextlib.contextmanager
def helper_replaced(threshold: float = 0.3) -> Iterator[Any]:
    """Gives the module of FrankaKitchen-v1; inside, the one helper is replaced that fails since MuJoCo 3.12.

    Args:
      threshold: distance from its goal below which a task is complete [rad, m].
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from gymnasium_robotics.envs.franka_kitchen import franka_env, kitchen_env

    def robot_get_obs(
        model: mujoco.MjModel, data: mujoco.MjData, names: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        del model, names
        return data.qpos[:9].copy(), data.qvel[:9].copy()

    with (
        mock.patch.object(franka_env, "robot_get_obs", robot_get_obs),
        mock.patch.object(kitchen_env, "BONUS_THRESH", threshold),
    ):
        yield kitchen_env


@contextlib.contextmanager
def original_environment(threshold: float = 0.3, **kwargs: Any) -> Iterator[Any]:
    """FrankaKitchen-v1; arguments as `helper_replaced`, and those of its class."""
    with helper_replaced(threshold) as kitchen_env:
        environment = kitchen_env.KitchenEnv(**kwargs)
        yield environment
        environment.close()


def has_envpool() -> bool:
    """Whether EnvPool is installed."""
    return importlib.util.find_spec("envpool") is not None


def envpool_kitchen(environments: int, threads: int) -> Any:
    """EnvPool's FrankaKitchen-v1, as a Gymnasium vector environment."""
    import envpool

    return envpool.make_gymnasium(
        "FrankaKitchen-v1", num_envs=environments, num_threads=threads, terminate_on_tasks_completed=False
    )

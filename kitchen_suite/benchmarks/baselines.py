"""Other implementations of FrankaKitchen-v1: Gymnasium-Robotics' and, where installed, EnvPool's."""

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


def _robot_get_obs(
    model: mujoco.MjModel, data: mujoco.MjData, names: Any
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the robot's joint positions (9,) and velocities (9,), as the helper did."""
    return data.qpos[:9].copy(), data.qvel[:9].copy()


def has_envpool() -> bool:
    """Returns whether EnvPool is installed."""
    return importlib.util.find_spec("envpool") is not None


def envpool_kitchen(num_envs: int, num_threads: int) -> Any:
    """Builds EnvPool's FrankaKitchen-v1, a Gymnasium vector environment; its episodes do not terminate."""
    import envpool

    return envpool.make_gymnasium(
        "FrankaKitchen-v1", num_envs=num_envs, num_threads=num_threads, terminate_on_tasks_completed=False
    )

"""The original: model and environment of FrankaKitchen-v1 in the installed gymnasium-robotics."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import warnings
from collections.abc import Iterator
from types import ModuleType
from typing import Any
from unittest import mock

import mujoco
from numpy.typing import NDArray

from kitchen_suite.entities import assets


def original_model() -> mujoco.MjModel:
    """Compiles the model of FrankaKitchen-v1."""
    return mujoco.MjModel.from_xml_path(str(assets.asset_dir() / "kitchen_assets" / "kitchen_env_model.xml"))


@contextlib.contextmanager
def patched_kitchen_env() -> Iterator[ModuleType]:
    """Yields Gymnasium-Robotics' module `kitchen_env`, with the one helper replaced that fails since MuJoCo 3.12.

    The helper is a function that the robot's class calls by its global name, and the robot's class is one that the
    kitchen's class builds by its global name, so a subclass cannot replace either.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from gymnasium_robotics.envs.franka_kitchen import franka_env, kitchen_env

    with mock.patch.object(franka_env, "robot_get_obs", _robot_get_obs):
        yield kitchen_env


def _robot_get_obs(model: Any, data: Any, names: Any) -> tuple[NDArray, NDArray]:
    """Returns the robot's joint positions (9,) and velocities (9,), as the helper did."""
    return data.qpos[:9].copy(), data.qvel[:9].copy()

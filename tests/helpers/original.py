"""The original: model and environment of FrankaKitchen-v1 in the installed gymnasium-robotics."""

import contextlib
from collections.abc import Iterator
from typing import Any
from unittest import mock

import mujoco
import numpy as np
from docs_scripts import load_script

_original = load_script("experiments/original")
reference_model = _original.original_model

# The reference's names of the moving bodies, by ours.
BODIES = {
    **{f"franka/link{i}": f"panda0_link{i}" for i in range(1, 8)},
    "franka/left_finger": "panda0_leftfinger",
    "franka/right_finger": "panda0_rightfinger",
    **{f"oven/knob_{i}": f"knob {i}" for i in range(1, 5)},
    "oven/bottom_right_burner": "Burner 1",
    "oven/bottom_left_burner": "Burner 2",
    "oven/top_right_burner": "Burner 3",
    "oven/top_left_burner": "Burner 4",
    "hood/switch": "lightswitchroot",
    "hood/lamp": "lightblock_hinge",
    "slide_cabinet/door": "slidelink",
    "hinge_cabinet/left_door": "hingeleftdoor",
    "hinge_cabinet/right_door": "hingerightdoor",
    "microwave/door": "microdoorroot",
    "kettle/": "kettle",
    "kettle/kettle": "kettleroot",
}


@contextlib.contextmanager
def original_environment(threshold: float = 0.3, **kwargs: Any) -> Iterator[Any]:
    """Yields FrankaKitchen-v1, in which a task is complete below `threshold` [rad, m]; `kwargs` are its arguments."""
    with _original.patched_kitchen_env() as kitchen_env, mock.patch.object(kitchen_env, "BONUS_THRESH", threshold):
        environment = kitchen_env.KitchenEnv(**kwargs)
        yield environment
        environment.close()


def reference_joint(name: str) -> str:
    """Returns the reference's name of one of our joints."""
    entity, _, joint = name.partition("/")
    return {"franka": f"robot:{joint}", "kettle": "kettle"}.get(entity, joint)


def colliding_geoms(model: mujoco.MjModel) -> list[int]:
    return [i for i in range(model.ngeom) if model.geom_contype[i] or model.geom_conaffinity[i]]


def same_geoms(ours: mujoco.MjModel, reference: mujoco.MjModel) -> dict[int, int]:
    """Returns the reference's colliding geom for each of ours: the one with the same pose, to the last bit.

    Raises:
      KeyError: the reference has no geom with that pose.
    """
    numbers = {pose: number for number, pose in _geom_poses(reference).items()}
    return {number: numbers[pose] for number, pose in _geom_poses(ours).items()}


def _geom_poses(model: mujoco.MjModel) -> dict[int, tuple[float, ...]]:
    """Returns the poses of all colliding geoms in the world, joints at zero."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {i: (*data.geom_xpos[i], *data.geom_xmat[i]) for i in colliding_geoms(model)}


def random_actions(rng: np.random.Generator, steps: int) -> np.ndarray:
    """Returns actions of a random walk that touches objects: some are held for a while, some drawn at every step."""
    held = np.repeat(rng.uniform(-1.0, 1.0, (-(-steps // 14), 9)), 14, axis=0)[:steps]
    return np.where(rng.random((steps, 1)) < 0.7, held, rng.uniform(-1.0, 1.0, (steps, 9)))

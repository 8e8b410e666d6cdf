"""The original: FrankaKitchen-v1 of the installed gymnasium-robotics, its model and its code."""

import mujoco
import numpy as np

from kitchen_suite.benchmarks.baselines import original_environment as original_environment
from kitchen_suite.benchmarks.baselines import original_model as reference_model  # noqa: F401

# What the reference calls the bodies that move, by what we call them.
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


def reference_joint(name: str) -> str:
    """What the reference calls one of our joints."""
    entity, _, joint = name.partition("/")
    return {"franka": f"robot:{joint}", "kettle": "kettle"}.get(entity, joint)


def colliding_geoms(model: mujoco.MjModel) -> list[int]:
    return [i for i in range(model.ngeom) if model.geom_contype[i] or model.geom_conaffinity[i]]


def same_geoms(ours: mujoco.MjModel, reference: mujoco.MjModel) -> dict[int, int]:
    """The reference's colliding geom for each of ours: the one at the very same place, to the last bit.

    Raises:
      KeyError: the reference has no geom there.
    """
    numbers = {place: number for number, place in _places(reference).items()}
    return {number: numbers[place] for number, place in _places(ours).items()}


def _places(model: mujoco.MjModel) -> dict[int, tuple[float, ...]]:
    """Position and orientation in the world of all colliding geoms, joints at zero."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {i: (*data.geom_xpos[i], *data.geom_xmat[i]) for i in colliding_geoms(model)}


def random_actions(rng: np.random.Generator, steps: int) -> np.ndarray:
    """Actions of a random walk that gets about and touches things: some held for a while, some drawn anew each step."""
    held = np.repeat(rng.uniform(-1.0, 1.0, (-(-steps // 14), 9)), 14, axis=0)[:steps]
    return np.where(rng.random((steps, 1)) < 0.7, held, rng.uniform(-1.0, 1.0, (steps, 9)))

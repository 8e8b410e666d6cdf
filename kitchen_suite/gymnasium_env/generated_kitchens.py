"""Generated kitchens as Gymnasium environments."""

from typing import Any

import numpy as np

from kitchen_suite.entities.kitchen_designs import Design
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_TIMESTEP


class GeneratedKitchenEnv(SuiteEnv):
    """A Franka in a generated kitchen, over `GeneratedKitchenTask`: it opens, closes, turns on or off, and moves parts.

    Observation: 363 numbers, float32, fewer with `num_slots`; the same in all kitchens. See docs/domains/kitchens.md.
    Action: nine joint velocities in [-1, 1], float32, as in the kitchen.
    Info: arrays `(16,)` in the order of the design's parts: `openings`, `goal_openings` and `requested_tasks_mask`, 0
      where there is no part; `requested_order`, -1 for what is not requested, and `completion_steps`, -1 for what has
      not been completed. Arrays of shape `()`: `is_success` and `episode_step`. With a dense reward its terms, such as
      `reward/approach`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": 1 / CONTROL_TIMESTEP}
    default_domain = "kitchens"
    default_cameras = ("workspace",)
    free_camera = {"distance": 2.6, "azimuth": 80.0, "elevation": -25.0, "lookat": np.array([0.0, 0.4, 1.9])}

    def __init__(self, design: Design = 0, split: str = "train", **arguments: Any) -> None:
        """Builds the environment; arguments as in `build_generated_kitchen`, `GeneratedKitchenTask` and `SuiteEnv`."""
        super().__init__(design=design, split=split, **arguments)

"""The domains with a cabinet, a table or a generated kitchen: named classes with their spaces and views."""

from typing import Any

import numpy as np

from kitchen_suite.entities.designs import Design
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks.kitchen.action import CONTROL_TIMESTEP as KITCHENS_TIMESTEP
from kitchen_suite.tasks.microwave_table.mdp import CONTROL_TIMESTEP as MICROWAVE_TIMESTEP
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP


class FrankaOpenCabinetEnv(SuiteEnv):
    """A Franka in front of a cabinet, over `OpenCabinetTask`: it grasps the handle of a drawer and pulls.

    Observation: 25 numbers in [-5, 5], float32; table in docs/domains/open_cabinet.md.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, unbounded, float32.
    Info: arrays of shape `()`, which recorders can stack. `reward/<term>` is each of the seven terms of the reward,
      `drawer_opening` the drawer's position [m], `is_success` whether that is 0.3 m or more now, `success_at_any_time`
      whether it has been in this episode, and `episode_step` the number of control steps.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / CONTROL_TIMESTEP)}
    default_domain = "open_cabinet"
    free_camera = {"distance": 2.2, "azimuth": 125.0, "elevation": -25.0, "lookat": np.array([0.4, 0.0, 0.5])}

    def __init__(self, drawer: str = "top", **arguments: Any) -> None:
        """Builds the environment; arguments as of `OpenCabinetTask`, `build_open_cabinet_scene` and `SuiteEnv`."""
        super().__init__(drawer=drawer, **arguments)


class FrankaMicrowaveTableEnv(SuiteEnv):
    """A Franka before a microwave on a table, over `MicrowaveTableTask`: it pulls the door open.

    Observation: 23 numbers, float32; table in docs/domains/microwave_table.md.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, in [-1, 1] by default, float32.
    Info: arrays of shape `()`. `reward/<term>` is each of the two terms of the reward, `door_opening` the door's angle
      as a share of its goal, `is_success` whether it is within the threshold now, `success_at_any_time` whether it has
      been in this episode, and `episode_step` the number of control steps.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / MICROWAVE_TIMESTEP)}
    default_domain = "microwave_table"
    free_camera = {"distance": 2.2, "azimuth": -35.0, "elevation": -25.0, "lookat": np.array([0.5, 0.1, 0.9])}

    def __init__(self, *, action_limit: float | None = 1.0, **arguments: Any) -> None:
        """Builds the environment; arguments as of `MicrowaveTableTask` and `SuiteEnv`."""
        super().__init__(action_limit=action_limit, **arguments)


class KitchensEnv(SuiteEnv):
    """A Franka in a generated kitchen, over `KitchensTask`: it opens, closes, turns on or off, and moves parts.

    Observation: 363 numbers, float32, fewer with `num_slots`; the same in all kitchens. See docs/domains/kitchens.md.
    Action: nine joint velocities in [-1, 1], float32, as in the kitchen.
    Info: arrays `(16,)` in the order of the design's parts: `openings`, `goal_openings` and `requested_tasks_mask`, 0
      where there is no part; `requested_order`, -1 for what is not requested, and `completion_steps`, -1 for what has
      not been completed. Arrays of shape `()`: `is_success` and `episode_step`. With a dense reward its terms, such as
      `reward/approach`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": 1 / KITCHENS_TIMESTEP}
    default_domain = "kitchens"
    default_cameras = ("workspace",)
    free_camera = {"distance": 2.6, "azimuth": 80.0, "elevation": -25.0, "lookat": np.array([0.0, 0.4, 1.9])}

    def __init__(self, design: Design = 0, split: str = "train", **arguments: Any) -> None:
        """Builds the environment; arguments as of `build_generated_kitchen`, `KitchensTask` and `SuiteEnv`."""
        super().__init__(design=design, split=split, **arguments)

"""The microwave_table domain as a Gymnasium environment."""

from typing import Any

import numpy as np

from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks.microwave_table.mdp import CONTROL_TIMESTEP


class FrankaMicrowaveTableEnv(SuiteEnv):
    """A Franka before a microwave on a table, over `MicrowaveTableTask`: it pulls the door open.

    Observation: 23 numbers, float32; table in docs/domains/microwave_table.md.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, in [-1, 1] by default, float32.
    Info: arrays of shape `()`. `reward/<term>` is each of the two terms of the reward, `door_opening` the door's angle
      as a share of its goal, `is_success` whether it is within the threshold now, `success_at_any_time` whether it has
      been in this episode, and `episode_step` the number of control steps.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / CONTROL_TIMESTEP)}
    default_domain = "microwave_table"
    free_camera = {"distance": 2.2, "azimuth": -35.0, "elevation": -25.0, "lookat": np.array([0.5, 0.1, 0.9])}

    def __init__(self, *, action_limit: float | None = 1.0, **arguments: Any) -> None:
        """Builds the environment; arguments as in `MicrowaveTableTask` and `SuiteEnv`."""
        super().__init__(action_limit=action_limit, **arguments)

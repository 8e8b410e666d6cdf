"""The open_cabinet domain as a Gymnasium environment."""

from typing import Any

import numpy as np

from kitchen_suite.gymnasium_env.base import SuiteEnv
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
        """Builds the environment; arguments as in `OpenCabinetTask`, `build_open_cabinet_scene` and `SuiteEnv`."""
        super().__init__(drawer=drawer, **arguments)

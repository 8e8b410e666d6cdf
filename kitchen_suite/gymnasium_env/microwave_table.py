"""A Franka before a microwave on a table as a Gymnasium environment: a door to be opened, with a dense reward."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kitchen_suite.domains.microwave_table import microwave_table
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.flat import FlatEnv
from kitchen_suite.tasks.microwave_table.mdp import CONTROL_TIMESTEP


class FrankaMicrowaveTableEnv(FlatEnv):
    """A Franka before a microwave on a table, over `MicrowaveTableTask`: it pulls the door open.

    Observation: 23 numbers, float32; table in docs/microwave_table.md.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, in [-1, 1] by default, float32.
    Info: arrays of shape `()`. `reward/<term>` is each of the two terms of the reward, `door_opening` the door's angle
      as a share of its goal, `is_success` whether it is within the threshold now, `success_at_any_time` whether it has
      been in this episode, and `episode_step` the number of control steps.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / CONTROL_TIMESTEP)}

    def __init__(
        self,
        *,
        gripper: str | None = None,
        threshold: float = 0.3,
        action_limit: float | None = 1.0,
        **settings: Any,
    ) -> None:
        """Builds the environment.

        Args:
          gripper: of the control mode `joint_offset`: `deterministic`, the default, closes the gripper where the
            action's last element is positive; `sampled` with the probability of that logit.
          threshold: distance from the goal below which the door counts as open [rad].
          action_limit: bound of the action space, to which actions are clipped; without bounds when None.
          **settings: of rendering, of the observation type and of the control mode, such as `render_mode`, `obs_type`
            and `control_mode`; and `max_episode_steps`. See `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        task_options = {"gripper": gripper, "threshold": threshold}
        super().__init__(action_limit=action_limit, task_options=task_options, **settings)

    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        return microwave_table(**task_options)

    def _default_camera_config(self) -> dict[str, Any]:
        return {"distance": 2.2, "azimuth": -35.0, "elevation": -25.0, "lookat": np.array([0.5, 0.1, 0.9])}

"""The cabinet as a Gymnasium environment: a drawer to be opened, with a dense reward."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kitchen_suite import suite
from kitchen_suite.domains.microwave_table import microwave_table
from kitchen_suite.entities import CabinetConfig
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import FlatEnv, SuiteEnv
from kitchen_suite.gymnasium_env.observations import ObservationConfig
from kitchen_suite.tasks import Randomization
from kitchen_suite.tasks.microwave_table.mdp import CONTROL_TIMESTEP as MICROWAVE_TIMESTEP
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP


class FrankaOpenCabinetEnv(FlatEnv):
    """A Franka in front of a cabinet, over `OpenCabinetTask`: it grasps the handle of a drawer and pulls.

    Observation: 25 numbers in [-5, 5], float32; table in docs/open_cabinet.md.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, unbounded, float32.
    Info: arrays of shape `()`, which recorders can stack. `reward/<term>` is each of the seven terms of the reward,
      `drawer_opening` the drawer's position [m], `is_success` whether that is 0.3 m or more now, `success_at_any_time`
      whether it has been in this episode, and `episode_step` the number of control steps.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / CONTROL_TIMESTEP)}
    observed = ObservationConfig(limit=drawer_observation.LIMIT)

    def __init__(
        self,
        drawer: str = "top",
        *,
        gripper: str | None = None,
        reward: str = "original",
        observation_noise: Mapping[str, float] | None = None,
        randomization: Randomization | Mapping[str, Any] | str | None = None,
        cabinet_config: CabinetConfig | None = None,
        action_limit: float | None = None,
        **settings: Any,
    ) -> None:
        """Builds the environment.

        Args:
          drawer: `top` or `bottom`.
          gripper: of the control mode `joint_offset`: `sampled`, the default, closes the gripper with the probability
            of the action's last element; `deterministic` closes it where that probability is above one half.
          reward: `original`, or `grasp`, which rewards opening only while both finger pads hold the handle.
          observation_noise: half width of the uniform noise on parts of the observation, by the names of the parts;
            none when omitted.
          randomization: parameters of the scene that a reset draws: a `Randomization`, variations by parameter, also
            as JSON describes them, or the name of a preset, `moderate`; none when omitted.
          cabinet_config: dimensions and joint resistances of the cabinet; the default cabinet when omitted.
          action_limit: bound of the action space, for agents that need a finite one; actions are clipped to it. The
            space is unbounded when omitted.
          **settings: of rendering, of the observation type and of the control mode, such as `render_mode`, `obs_type`
            and `control_mode`; and `max_episode_steps`. See `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        task_options = {
            "drawer": drawer,
            "gripper": gripper,
            "reward": reward,
            "observation_noise": observation_noise,
            "randomization": randomization,
            "cabinet_config": cabinet_config,
        }
        super().__init__(action_limit=action_limit, task_options=task_options, **settings)

    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        return suite.open_cabinet(**task_options)

    def _default_camera_config(self) -> dict[str, Any]:
        return {"distance": 2.2, "azimuth": 125.0, "elevation": -25.0, "lookat": np.array([0.4, 0.0, 0.5])}


class FrankaMicrowaveTableEnv(FlatEnv):
    """A Franka before a microwave on a table, over `MicrowaveTableTask`: it pulls the door open.

    Observation: 23 numbers, float32; table in docs/microwave_table.md.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, in [-1, 1] by default, float32.
    Info: arrays of shape `()`. `reward/<term>` is each of the two terms of the reward, `door_opening` the door's angle
      as a share of its goal, `is_success` whether it is within the threshold now, `success_at_any_time` whether it has
      been in this episode, and `episode_step` the number of control steps.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / MICROWAVE_TIMESTEP)}

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

"""The cabinet as a Gymnasium environment: a drawer to be opened, with a dense reward."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks, suite
from kitchen_suite.entities import CabinetConfig
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks import Randomization
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet.action import JOINT_LOW
from kitchen_suite.tasks.open_cabinet.features import Features
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP, OpenCabinetState


class FrankaOpenCabinetEnv(SuiteEnv):
    """A Franka before a cabinet: grasp a drawer's handle and pull, over `OpenCabinetTask`.

    Observation: 25 numbers in [-5, 5], float32; docs/open_cabinet.md has the table.
    Action: seven joint offsets [rad] and the log odds of closing the gripper, unbounded, float32.
    Info: see `info`.
    """

    metadata = {**SuiteEnv.metadata, "render_fps": round(1 / CONTROL_TIMESTEP)}

    def __init__(
        self,
        drawer: str = "top",
        *,
        gripper: str = "sampled",
        reward: str = "original",
        observation_noise: Mapping[str, float] | None = None,
        randomization: Randomization | None = None,
        cabinet_config: CabinetConfig | None = None,
        action_limit: float | None = None,
        **settings: Any,
    ) -> None:
        """Builds the environment.

        Args:
          drawer: `top` or `bottom`.
          gripper: `sampled` or `deterministic`; see `OpenCabinetTask`, as for the three that follow.
          reward: `original` or `grasp`.
          observation_noise: half width of the uniform noise on parts of the observation, by their names.
          randomization: what else a reset draws.
          cabinet_config: sizes and resistances of the cabinet.
          action_limit: bounds of the action space, for agents that insist on finite ones; actions are clipped to them.
            Without it the space is unbounded.
          **settings: `max_episode_steps`, `render_mode`, `width`, `height`, `camera_id`, `camera_name`,
            `default_camera_config`, `max_geom`, `visual_options` and `visuals`; see `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        limit = math.inf if action_limit is None else checks.number(action_limit, "action_limit", positive=True)
        task_options = {
            "drawer": drawer,
            "gripper": gripper,
            "reward": reward,
            "observation_noise": observation_noise,
            "randomization": randomization,
            "cabinet_config": cabinet_config,
        }
        super().__init__(task_options=task_options, **settings)
        self._task = self._environment.task
        self._action_limit = limit
        self.action_space = spaces.Box(-limit, limit, JOINT_LOW.shape, np.float32)
        bound = drawer_observation.LIMIT
        self.observation_space = spaces.Box(-bound, bound, (drawer_observation.SIZE,), np.float32)

    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        return suite.open_cabinet(**task_options)

    def _default_camera_config(self) -> dict[str, Any]:
        return {"distance": 2.2, "azimuth": 125.0, "elevation": -25.0, "lookat": np.array([0.4, 0.0, 0.5])}

    def _get_obs(self, observation: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        return np.concatenate([*observation.values()])

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Makes one control step; see `SuiteEnv.step`."""
        return super().step(self.clip_actions(checks.vector(action, JOINT_LOW.size, "action")))

    def clip_actions(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Actions `(..., 8)` clipped to the `action_limit`, where there is one."""
        return actions if self._action_limit == math.inf else actions.clip(-self._action_limit, self._action_limit)

    def _get_info(self) -> dict[str, Any]:
        """Makes the info of the last step or reset; arrays of shape `()`, which recorders can stack.

        `reward/<term>`: each of the seven terms; `drawer_opening` [m]; `is_success`: open by 0.3 m or more now;
        `success_at_any_time`: in this episode; `episode_step`.
        """
        return {**results_arrays(self._task.state), "episode_step": np.array(self._episode_step)}


def results_arrays(state: OpenCabinetState) -> dict[str, NDArray]:
    """What infos say of the drawer and of the last step's reward, in fresh arrays `(...)`."""
    return {
        **{f"reward/{name}": np.array(term) for name, term in state.terms.items()},
        "drawer_opening": np.array(Features(state.features).drawer_position),
        "is_success": np.array(state.is_success),
        "success_at_any_time": np.array(state.succeeded),
    }

"""The base of Gymnasium environments whose observation is one array."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_env import specs
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.gymnasium_env.base import SuiteEnv


class FlatEnv(SuiteEnv):
    """An environment whose observation is one array, and whose infos are arrays of shape `()`.

    Infos are those of the task's MDP, and `episode_step`, the number of control steps.
    """

    def __init__(self, *, action_limit: float | None, task_options: Mapping[str, Any], **settings: Any) -> None:
        """Builds the environment.

        Args:
          action_limit: bound of the action space of `joint_offset`, to which actions are clipped; without bounds when
            None. The other control modes have bounds of their own.
          task_options: arguments of the domain's builder.
          **settings: further arguments of `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        limit = math.inf if action_limit is None else checks.number(action_limit, "action_limit", positive=True)
        super().__init__(task_options=task_options, **settings)
        (self._action_size,) = self._environment.action_spec().shape
        # Modes with bounds of their own need no other.
        has_bounds = isinstance(self._environment.action_spec(), specs.BoundedArray)
        self._action_limit = math.inf if has_bounds else limit
        if not has_bounds:
            self.action_space = spaces.Box(-limit, limit, (self._action_size,), np.float32)

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Makes one control step; see `SuiteEnv.step`."""
        if self._action_limit < math.inf:
            # NaN and inf must not be clipped away: check first. Without a limit only the task checks.
            action = self.clip_actions(checks.vector(action, self._action_size, "action"))
        return super().step(action)

    def clip_actions(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns actions `(..., k)` clipped to the `action_limit`, if there is one."""
        return actions if self._action_limit == math.inf else actions.clip(-self._action_limit, self._action_limit)

    def _get_info(self) -> dict[str, Any]:
        return {**self._task.mdp.info(self._task.state), "episode_step": np.array(self._episode_step)}

"""What every task of the suite has beside what composer asks of it."""

import abc
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control import composer, mjcf

from kitchen_suite import checks


class SuiteTask(composer.Task):
    """A task that tells its state and its results, and can show its reward by colour."""

    _random: np.random.RandomState
    _visualize_reward = False

    @property
    def random(self) -> np.random.RandomState:
        """The random state that the environment last passed to the task."""
        return self._random

    @property
    def visualize_reward(self) -> bool:
        """Whether things show by their colour that they pay."""
        return self._visualize_reward

    @visualize_reward.setter
    def visualize_reward(self, value: bool) -> None:
        self._visualize_reward = checks.boolean(value, "visualize_reward")

    @property
    @abc.abstractmethod
    def episode_results(self) -> dict[str, bool | float | dict[str, int]]:
        """What came of the episode so far, for reports: verdicts, measures, and control steps by what happened then."""

    @abc.abstractmethod
    def get_state(self) -> dict[str, Any]:
        """What the task remembers from step to step beside the physics; nested dicts of strings and fresh arrays."""

    @abc.abstractmethod
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Takes up what `get_state` gave.

        Raises:
          TypeError: something in it is of the wrong type.
          ValueError: something in it is missing, is of another task, has the wrong shape or is out of range; nothing
            has changed then.
        """

    def get_discount(self, physics: mjcf.Physics) -> float:
        return 0.0 if self.should_terminate_episode(physics) else 1.0

"""The interface of the suite's tasks, beyond that of `composer.Task`."""

import abc
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control import composer, mjcf
from numpy.typing import NDArray

from kitchen_suite import checks

# Colour of objects that the task counts as a success.
SUCCESS_RGBA = (0.25, 0.75, 0.3, 1.0)

# Verdicts, measures, and the control steps at which goals were completed, by the goals' names.
Metrics = dict[str, bool | float | dict[str, int]]


class SuiteTask(composer.Task):
    """A task with saved states, metrics of its episodes, and optional highlighting of success."""

    _random: np.random.RandomState
    _visualize_reward = False

    @property
    def random(self) -> np.random.RandomState:
        """The random state that the environment last passed to the task."""
        return self._random

    @property
    def visualize_reward(self) -> bool:
        """Whether objects change their colour while the task rewards their position."""
        return self._visualize_reward

    @visualize_reward.setter
    def visualize_reward(self, value: bool) -> None:
        self._visualize_reward = checks.boolean(value, "visualize_reward")

    @property
    @abc.abstractmethod
    def mdp(self) -> Any:
        """The task's settings, and the mathematics of an episode under them."""

    @property
    @abc.abstractmethod
    def state(self) -> Any:
        """The MDP's state of the present episode; arrays without leading axes, not to be written to."""

    @property
    @abc.abstractmethod
    def observation_size(self) -> int:
        """Number of elements of the flat observation, goals included."""

    @property
    def episode_metrics(self) -> Metrics:
        """Metrics of the present episode up to the last control step; see `metrics`."""
        return self.metrics(self.mdp.info(self.state))

    @abc.abstractmethod
    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns the metrics of an episode.

        Args:
          infos: its last infos, of the Gymnasium environment or from a recording; arrays without leading axis.
        """

    def begin_run(self) -> None:
        """Resets all memory of earlier episodes, so that a run does not depend on earlier ones."""

    def restore(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> None:
        """Moves robot and objects to the positions and velocities of a recorded observation.

        The caller updates what MuJoCo derives from these, as `Environment.set_state` does.

        Raises:
          ValueError: the task's episodes start from a seed only.
        """
        raise ValueError(f"an episode of {type(self).__name__} can be repeated only from its seed, which is missing")

    def set_observed_positions(self, observation: NDArray[np.float64]) -> None:
        """Makes the next action start from the robot's positions in a recorded observation.

        Raises:
          ValueError: the task's episodes start from a seed only.
        """
        raise ValueError(f"an episode of {type(self).__name__} can be repeated only from its seed, which is missing")

    def is_initial(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> bool:
        """Whether a recorded observation is one of the present physics state, up to noise and rounding."""
        return True

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        """Names of the task's goals, and whether each is reached after each step of a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.

        Returns:
          `n` names and a mask `(T + 1, n)`; None if the arrays do not determine it.
        """
        return None

    @abc.abstractmethod
    def get_state(self) -> dict[str, Any]:
        """Returns the task's state beside the physics: nested dicts of strings and fresh arrays."""

    @abc.abstractmethod
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Sets a state that `get_state` returned.

        Raises:
          TypeError: an element is of the wrong type.
          ValueError: an element is missing, is of another task, has the wrong shape or is out of range; the task is
            unchanged then.
        """

    def get_discount(self, physics: mjcf.Physics) -> float:
        return 0.0 if self.should_terminate_episode(physics) else 1.0

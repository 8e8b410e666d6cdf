"""Inputs of trained policies, and the names of the policies for a task."""

import abc
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

# Number of axes of an observed picture.
_PICTURE_AXES = 3


class LearnedTask(abc.ABC):
    """A task that trained policies act in."""

    @property
    @abc.abstractmethod
    def observation_size(self) -> int:
        """Number of elements of the flat observation, goals included."""

    @property
    def state_size(self) -> int:
        """Number of elements at the beginning of the flat observation that are no goals and no requests of tasks."""
        return self.observation_size

    @property
    def task_names(self) -> tuple[str, ...]:
        """Names of the tasks that episodes may ask for; empty if the task has no parts."""
        return ()

    def policy_inputs(self, observation: Mapping[str, NDArray], tasks: Sequence[str]) -> NDArray[np.float64]:
        """Returns the inputs `(m,)` of a policy without goals: the state, and 1 for each of `tasks` that is asked.

        Args:
          observation: of a dm_env time step.
          tasks: names, in the order of the policy.
        """
        del tasks
        flat = [np.ravel(array) for array in observation.values() if np.ndim(array) < _PICTURE_AXES]
        return np.concatenate(flat)[: self.state_size]

    @property
    def policy_key(self) -> str:
        """Name of trained policies for the task; equal for tasks that differ neither in goals nor in rewards."""
        return type(self).__name__

    @property
    def general_policy_keys(self) -> tuple[str, ...]:
        """Names of trained policies for more than the task, which can be asked for the task alone."""
        return ()

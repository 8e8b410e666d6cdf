"""The observation of a task as trained policies take it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.types import Array

PICTURE_AXES = 3  # Number of axes of an observed picture: height, width, channels.


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolicyInputs:
    """The observation of a task as trained policies take it.

    The flat observation is the state, then goals and requests of tasks, without pictures.

    Attributes:
      names: names of trained policies for the task, the most specific one first. The first is equal for tasks that
        differ neither in goals nor in rewards.
      state_size: number of elements of the state.
      goal_size: number of elements of the achieved and the desired goal.
      tasks: names of the tasks that episodes may ask for; empty if the task has no parts.
      observes_requests: whether the observation ends with the request: 1 for each requested one of `tasks`, else 0.
      keys: beginnings of the keys of goals and requests, in the order of the flat observation; all other keys are of
        the state.
    """

    names: tuple[str, ...]
    state_size: int
    goal_size: int = 0
    tasks: tuple[str, ...] = ()
    observes_requests: bool = False
    keys: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of elements of the flat observation."""
        return self.state_size + self.goal_size + self.observes_requests * len(self.tasks)

    def flatten(self, observation: NDArray | Mapping[str, Any]) -> NDArray:
        """Returns the flat observation `(..., m)`.

        Args:
          observation: of a dm_env time step, a Gymnasium environment or a recorded episode: `(..., m)`, returned as it
            is; or arrays `(..., k)` by key, with goals as arrays or by task.
        """
        if not isinstance(observation, Mapping):
            return observation
        order = {key: place for place, key in enumerate(self.keys, start=1)}
        keys = sorted(observation, key=lambda key: order.get(key.partition("/")[0], 0))
        arrays: list[NDArray] = []
        for value in (observation[key] for key in keys):
            arrays += value.values() if isinstance(value, Mapping) else [np.atleast_1d(value)]
        return np.concatenate([array for array in arrays if array.ndim < PICTURE_AXES], axis=-1)

    def state_and_requests(self, observation: NDArray | Mapping[str, Any], tasks: Sequence[str]) -> Array:
        """Returns the inputs `(..., n)` of a policy without goals: the state, and 1 for each requested task.

        Args:
          observation: as `flatten` takes it; without requests, it asks for all tasks.
          tasks: names, in the order of the policy.
        """
        flat = self.flatten(observation)
        count, none = len(self.tasks), np.zeros((*flat.shape[:-1], 1))
        requests = flat[..., -count:] if self.observes_requests else np.ones((*flat.shape[:-1], count))
        requested = {name: requests[..., i : i + 1] for i, name in enumerate(self.tasks)}
        return np.concatenate([flat[..., : self.state_size], *(requested.get(name, none) for name in tasks)], axis=-1)

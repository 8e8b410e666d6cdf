"""Copies of Gymnasium environments: by `copy.deepcopy` and pickle, in the middle of an episode."""

import abc
import copy
from collections.abc import Mapping
from typing import Any, Self

import gymnasium
import numpy as np


class CopiedEnv(gymnasium.Env):
    """An environment that is copied by its arguments and its state."""

    @abc.abstractmethod
    def get_state(self) -> dict[str, Any]:
        """Returns the state on which later steps depend."""

    @abc.abstractmethod
    def set_state(self, state: Mapping[str, Any]) -> Any:
        """Sets a state that `get_state` returned."""

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Stores the arguments, from which copies are built."""
        self = super().__new__(cls)
        self._arguments = copy.deepcopy((args, kwargs))
        return self

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": self._arguments,
            "state": self.get_state(),
            "seed": self._np_random_seed,
            "spec": self.spec,
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self._arguments = args, kwargs = state["arguments"]
        type(self).__init__(self, *args, **kwargs)
        self.spec = state["spec"]
        bit_generator = getattr(np.random, state["state"]["random"]["bit_generator"])
        self.np_random = np.random.Generator(bit_generator())
        self.set_state(state["state"])
        self._np_random_seed = state["seed"]

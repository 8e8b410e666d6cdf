"""Rewards of named terms."""

import functools
import operator
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Reward(Protocol):
    """A reward function; which values of a step it takes is the domain's own.

    Attributes:
      terms: names of the terms, which sum to the reward.
    """

    @property
    def terms(self) -> tuple[str, ...]: ...

    def __call__(self, *values: Any, **named: Any) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` of a step by name."""


def total(terms: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Returns the reward `(...)`, the sum of its terms."""
    return functools.reduce(operator.add, terms.values())

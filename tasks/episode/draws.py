"""Random draws of control steps: of one episode, and of many, each from its own stream, to the bit the same numbers."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from kitchen_suite.tasks.control_modes.action_mode import MEDIAN
from kitchen_suite.types import Array

# Returns some arrays `(k,)` of one episode by name, with noise that is drawn from its random state.
Corruption = Callable[[Mapping[str, Array], np.random.RandomState], dict[str, Array]]


class Draws(Protocol):
    """Random draws of one episode or of many, in the order in which they are asked for."""

    def uniform(self) -> Array | float:
        """Returns a number `(...)` from U(0, 1)."""

    def noise(self, size: int) -> Array:
        """Returns numbers `(..., size)` from U(-1, 1)."""

    def corrupted(self, values: Mapping[str, Array], corrupt: Corruption) -> dict[str, Array]:
        """Returns arrays `(..., k)` by name with the noise that a function draws for those of each episode."""


class SingleDraws:
    """Draws of one episode, from the random state that composer passes to its hooks."""

    def __init__(self, random_state: np.random.RandomState) -> None:
        self._random_state = random_state

    def uniform(self) -> float:
        return self._random_state.random_sample()

    def noise(self, size: int) -> Array:
        return self._random_state.uniform(-1.0, 1.0, size) if size else np.zeros(0)

    def corrupted(self, values: Mapping[str, Array], corrupt: Corruption) -> dict[str, Array]:
        return corrupt(values, self._random_state)


class NoDraws:
    """Stands for the draws of an episode from which nothing is drawn, such as that of a compiled scene: no noise."""

    def uniform(self) -> float:
        return MEDIAN

    def noise(self, size: int) -> Array:
        return np.zeros(size)

    def corrupted(self, values: Mapping[str, Array], corrupt: Corruption) -> dict[str, Array]:
        return {name: value.copy() for name, value in values.items()}


class Stream(Protocol):
    """A random stream.

    Attributes:
      generator: draws from the stream.
      random_state: draws from the same bit generator.
    """

    generator: np.random.Generator
    random_state: np.random.RandomState


class BatchDraws:
    """Draws of many episodes, each from a stream of its own.

    Attributes:
      rows: `(n,)`, the episodes for which numbers are drawn; the streams of the others stay as they are.
    """

    def __init__(self, streams: Sequence[Stream], size: int) -> None:
        """Prepares the draws.

        Args:
          streams: one for each of the `n` episodes; the sequence is read at each draw.
          size: of the noise.
        """
        self.rows = np.full(len(streams), True)
        self._streams = streams
        self._noise = np.zeros((len(streams), size))
        self._numbers = np.zeros_like(self._noise)
        self._numbers_of_each = [*self._numbers]

    def uniform(self) -> Array:
        """Returns numbers `(n,)` from U(0, 1); the median of it where none are drawn."""
        draws = np.full(self.rows.shape, MEDIAN)
        indices = self.rows.nonzero()[0]
        draws[indices] = [self._streams[i].random_state.random_sample() for i in indices.tolist()]
        return draws

    def noise(self, size: int) -> Array:
        """Returns numbers `(n, size)` from U(-1, 1), those of the last draw where none are drawn; not to be kept.

        `RandomState.uniform` of each stream would take three times as long.
        """
        if size:
            for i in self.rows.nonzero()[0].tolist():
                self._streams[i].generator.random(out=self._numbers_of_each[i])
            np.copyto(self._noise, 2.0 * self._numbers - 1.0, where=self.rows[:, np.newaxis])
        return self._noise

    def corrupted(self, values: Mapping[str, Array], corrupt: Corruption) -> dict[str, Array]:
        """Returns arrays `(n, k)` by name with noise; without it where none is drawn."""
        noisy = {name: value.copy() for name, value in values.items()}
        if not noisy:
            return noisy
        for i in self.rows.nonzero()[0].tolist():
            row = {name: value[i] for name, value in values.items()}
            for name, value in corrupt(row, self._streams[i].random_state).items():
                noisy[name][i] = value
        return noisy

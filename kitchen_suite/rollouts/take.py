"""An episode while it is being played in one of many environments."""

import time
from collections.abc import Callable, Mapping

import dm_env
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies import Policy
from kitchen_suite.rollouts.episode_arrays import STEP_ARRAYS, EpisodeArrays

# Observations and infos of one moment, by the names of `episode_arrays`.
Row = Mapping[str, NDArray]


class EpisodeBuffer:
    """An episode that is being played."""

    def __init__(self, index: int, seed: int, policy: Policy) -> None:
        self.index, self.seed = index, seed
        self.rows: list[Row] = []
        self._policy = policy
        self._steps: list[tuple] = []
        self._started = time.perf_counter()

    def act(self, view: Callable[[Row], dict[str, NDArray]]) -> NDArray[np.float64]:
        """What the policy does now."""
        observation = view(self.rows[-1])
        if not self._steps:
            return np.asarray(self._policy(dm_env.restart(observation)))
        return np.asarray(self._policy(dm_env.transition(self._steps[-1][1], observation)))

    def add(self, row: Row, step: tuple) -> None:
        """Adds what a step showed, and the step itself: action, reward, termination and truncation."""
        self.rows.append(row)
        self._steps.append(step)

    def finish(self, at_once: int) -> EpisodeArrays:
        """The whole episode; `at_once` of them were played in the same time."""
        arrays = {name: np.stack([row[name] for row in self.rows]) for name in self.rows[0]}
        columns = zip(*self._steps, strict=True)
        return EpisodeArrays(
            index=self.index,
            seed=self.seed,
            arrays={**arrays, **{name: np.stack(column) for name, column in zip(STEP_ARRAYS, columns, strict=True)}},
            seconds=(time.perf_counter() - self._started) / at_once,
        )

"""Small things of vectorised environments: random streams, rows of observations, Gymnasium's layout of infos."""

import os
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray


class Stream:
    """The random stream of one environment, as Gymnasium and as composer see it.

    Attributes:
      generator: what Gymnasium makes of the seed.
      seed: drawn by Gymnasium when `None` is given.
      random_state: draws the generator's numbers.
      sample: draws one of them from U(0, 1).
    """

    def __init__(self, seed: int | None) -> None:
        """Starts the stream."""
        self.generator, self.seed = gymnasium.utils.seeding.np_random(seed)
        self.random_state = np.random.RandomState(self.generator.bit_generator)
        self.sample = self.random_state.random_sample


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def row(observations: Any, i: int) -> Any:
    """A copy of one environment's observation."""
    if isinstance(observations, dict):
        return {key: row(part, i) for key, part in observations.items()}
    return observations[i].copy()


def masked(infos: Mapping[str, NDArray], mask: NDArray[np.bool_]) -> dict[str, NDArray]:
    """Infos as Gymnasium lays them out: nothing where the mask is False, and the mask beside each."""
    laid_out, partial = {}, not mask.all()
    for name, array in infos.items():
        if partial:
            array[~mask] = None if array.dtype == object else 0
        laid_out[name], laid_out[f"_{name}"] = array, mask.copy()
    return laid_out

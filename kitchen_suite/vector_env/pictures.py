"""The pictures that vectorised environments observe."""

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.vector_env.episodes import BatchEpisodes


class BatchPictures:
    """The pictures of many episodes, rendered one after the other by the environment that starts them.

    An episode is rendered again only after it has moved.
    """

    def __init__(self, environment: Environment, episodes: BatchEpisodes) -> None:
        """Prepares to take the pictures of the environment's task.

        Args:
          environment: with the compiled model; nothing else may step it.
          episodes: that are shown.
        """
        self._episodes, count = episodes, episodes.steps.size
        pictures = environment.task.pictures
        self._takers = pictures.takers(environment.physics)
        specs = {key: taker.array_spec for key, taker in pictures.by_name.items()}
        self._present = {key: np.zeros((count, *spec.shape), spec.dtype) for key, spec in specs.items()}

    def take(self) -> dict[str, NDArray]:
        """Returns the present pictures `(n, height, width, channels)` by observation key, in fresh arrays."""
        if not self._takers:
            return {}
        moved = self._episodes.has_moved
        for i in np.flatnonzero(moved).tolist():
            self._episodes.show(i)
            for key, take in self._takers.items():
                self._present[key][i] = take()
        moved[:] = False
        return {key: array.copy() for key, array in self._present.items()}

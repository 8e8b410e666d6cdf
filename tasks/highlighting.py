"""Colours that show which objects a task counts as a success."""

from collections.abc import Iterable, Sequence

import numpy as np
from dm_control import mjcf

SUCCESS_RGBA = (0.25, 0.75, 0.3, 1.0)  # Colour of objects that the task counts as a success.


class Highlighting:
    """Colours of some objects: their own, or green where the task counts them as a success."""

    def __init__(self, physics: mjcf.Physics, objects: Iterable[Sequence[mjcf.Element]]) -> None:
        """Stores the objects, each with its geoms, and their own colours."""
        self._physics, self._objects = physics, [*objects]
        self._own_rgba = [np.array(physics.bind(geoms).rgba) for geoms in self._objects]

    def update(self, successes: Iterable[bool]) -> None:
        """Colours the objects that are a success green, and restores the own colours of the others."""
        for geoms, own_rgba, is_success in zip(self._objects, self._own_rgba, successes, strict=True):
            self._physics.bind(geoms).rgba = SUCCESS_RGBA if is_success else own_rgba

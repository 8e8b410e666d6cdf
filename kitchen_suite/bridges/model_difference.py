"""The greatest difference between the numbers of two MuJoCo models of one scene."""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

# Texts and their addresses, which say where files lay, and keyframes: no physics and no image depends on them.
_LEFT_OUT = re.compile(r"names|names_map|paths|text_.*|.*_pathadr|name_\w+adr|key_.*")

# Structures of numbers within a model.
_PARTS = ("opt", "stat", "vis")


class Difference(NamedTuple):
    """The greatest difference of a number of two models.

    Attributes:
      value: its absolute value; infinite where an array has another shape.
      field: name of the field; empty if no number differs.
    """

    value: float
    field: str

    def __str__(self) -> str:
        return f"{self.value:.3g} ({self.field})" if self.field else "0"


def greatest_difference(one: mujoco.MjModel, other: mujoco.MjModel) -> Difference:
    """Returns the greatest difference over all numbers of two models but those of texts and keyframes."""
    others = dict(_numbers(other))
    differences = (Difference(_difference(array, others[name]), name) for name, array in _numbers(one))
    found = max(differences, key=lambda difference: difference.value)
    return found if found.value else Difference(0.0, "")


def _difference(one: NDArray, other: NDArray) -> float:
    if one.shape != other.shape:
        return float("inf")
    return float(np.abs(one.astype(np.float64) - other.astype(np.float64)).max(initial=0.0))


def _numbers(model: mujoco.MjModel) -> Iterator[tuple[str, NDArray]]:
    """Yields name and values of all fields."""
    for name in dir(model):
        if name in _PARTS:
            yield from _numbers_within(getattr(model, name), name)
        elif not name.startswith("_") and not _LEFT_OUT.fullmatch(name):
            value = getattr(model, name)
            if isinstance(value, np.ndarray):  # Sizes are those of the arrays.
                yield name, value


def _numbers_within(structure: Any, prefix: str) -> Iterator[tuple[str, NDArray]]:
    for name in dir(structure):
        if not name.startswith("_"):
            value, path = getattr(structure, name), f"{prefix}.{name}"
            if isinstance(value, int | float | np.ndarray):
                yield path, np.asarray(value)
            elif type(value).__module__.startswith("mujoco"):
                yield from _numbers_within(value, path)

"""The greatest difference between the numbers of two MuJoCo models of one scene."""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

# Texts and their addresses, which say where files lay, and keyframes: no physics and no image depends on them.
_LEFT_OUT = re.compile(r"names|names_map|paths|text_.*|.*_pathadr|name_\w+adr|key_.*")

# Fields that only images depend on, and statistics, which viewers use.
_VISUAL = re.compile(r"(cam|light|mat|mesh_tex|skin|tex)_.*|\w+_(matid|rgba)|bvh_aabb|(vis|stat)\..*")

# Frames of the inertia of bodies, without effect where there is no mass.
_INERTIAL = ("body_ipos", "body_iquat", "body_sameframe")

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


def greatest_difference(one: mujoco.MjModel, other: mujoco.MjModel, *, physical: bool = False) -> Difference:
    """Returns the greatest difference over the numbers of two models but those of texts and keyframes.

    Args:
      one: a model.
      other: a model of the same scene.
      physical: whether only those count that the physics depends on.
    """
    numbers = _physical_numbers if physical else _numbers
    others = dict(numbers(other))
    differences = (Difference(_difference(array, others[name]), name) for name, array in numbers(one))
    found = max(differences, key=lambda difference: difference.value)
    return found if found.value else Difference(0.0, "")


def _physical_numbers(model: mujoco.MjModel) -> Iterator[tuple[str, NDArray]]:
    for name, array in _numbers(model):
        if not _VISUAL.fullmatch(name):
            yield name, array[model.body_mass > 0] if name in _INERTIAL else array


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

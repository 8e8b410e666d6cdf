"""Checks of the arguments of vectorised environments.

They raise a TypeError for a value of the wrong type, and a ValueError for another that is refused.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.requests import VARIATION, VARIATION_VALUES
from kitchen_suite.tasks.variations.variations import flat_values


def actions(value: ArrayLike, space: gymnasium.Space) -> NDArray[np.float64]:
    """Returns finite actions of all environments as a fresh float64 array, unrounded."""
    array = checks.array_of(value, "actions")
    if array.dtype.kind not in "fiu":
        raise TypeError(f"actions must hold numbers, got {checks.shown(value)}")
    if array.shape != space.shape:
        raise ValueError(f"actions must have shape {space.shape}, got shape {array.shape}")
    if array.dtype == np.float64:
        array = array.copy()
    else:
        with np.errstate(over="ignore"):
            array = array.astype(np.float64)
    if not np.isfinite(array).all():
        rows = np.flatnonzero(~np.isfinite(array).all(axis=1)).tolist()
        raise ValueError(f"actions must be finite; those of environments {rows} are not")
    return array


def seeds(value: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    """Returns the seed of each of `count` environments, given that of environment 0, to which environment `i` adds `i`.

    Or `value` is a sequence of seeds, in which `None` continues the environment's stream.
    """
    if value is None:
        return [None] * count
    if isinstance(value, np.ndarray) and value.ndim:
        value = checks.array_of(value, "seed").tolist()
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        each = [*value]
    else:
        first = checks.integer(value, "seed", minimum=0)
        each = list(range(first, first + count))
    if len(each) != count:
        raise ValueError(f"seed must hold one seed for each of {count} environments, got {len(each)}")
    return [None if one is None else checks.integer(one, "seed", minimum=0) for one in each]


def autoreset_mode(mode: AutoresetMode, required: AutoresetMode) -> None:
    """Raises a ValueError unless an autoreset mode is the one that is required."""
    if mode != required:
        raise ValueError(f"autoreset_mode must be {required.value!r}, got {mode.value!r}")


def checked_mask(value: Any, count: int, name: str) -> NDArray[np.bool_]:
    """Returns a mask `(count,)` of environments, which must choose at least one."""
    if not isinstance(value, np.ndarray) or value.dtype != bool:
        raise TypeError(f"{name} must be an array of bools, got {checks.shown(value)}")
    if value.shape != (count,):
        raise ValueError(f"{name} must have shape ({count},), got shape {value.shape}")
    mask = checks.array_of(value, name)
    if not mask.any():
        raise ValueError(f"{name} must choose at least one environment")
    return mask


def options_of_each(
    options: Mapping[str, Any], own: Sequence[str], mask: NDArray[np.bool_]
) -> dict[int, dict[str, Any]]:
    """Returns the options of a reset for each environment of its mask, by index; empty if there are none.

    Args:
      options: of all environments: the names of `variation` are the same in all; `variation_values` are arrays
        `(n, ...)`; options of the task are sequences with an element for each environment, None for none.
      own: names of the options of the task.
      mask: `(n,)`, the environments that start an episode.
    """
    names, values = options.get(VARIATION), options.get(VARIATION_VALUES)
    rows = {name: checks.array_of(value, name) for name, value in flat_values(values or {}).items()}
    for name, array in rows.items():
        if array.shape[:1] != mask.shape:
            raise ValueError(f"variation_values of {name!r} must have {mask.size} rows, got shape {array.shape}")
    of_task = {name: options[name] for name in own if options.get(name) is not None}
    for name, elements in of_task.items():
        if not isinstance(elements, list | tuple | np.ndarray):
            shown = checks.shown(elements)
            raise TypeError(f"{name} must be a sequence of one element for each environment, got {shown}")
        if len(elements) != mask.size:
            raise ValueError(f"{name} must have one element for each of {mask.size} environments, got {len(elements)}")
    if names is None and values is None and not of_task:
        return {}
    return {
        i: {
            VARIATION: names,
            VARIATION_VALUES: {name: array[i] for name, array in rows.items()},
            **{name: elements[i] for name, elements in of_task.items()},
        }
        for i in mask.nonzero()[0].tolist()
    }

"""Nested arrays of many environments, and Gymnasium's layout of their infos."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import tree
from numpy.typing import NDArray


def repeat(state: Any, count: int) -> Any:
    """Returns the state of one episode `count` times, along a new first axis of every array."""
    return tree.map_structure(lambda array: np.repeat(np.asarray(array)[np.newaxis], count, axis=0), state)


def put(arrays: Sequence[NDArray], i: int, state: Any) -> None:
    """Writes the state of one episode to row `i` of the arrays of many, which are in the order of `tree.flatten`."""
    for rows, array in zip(arrays, tree.flatten(state), strict=True):
        rows[i] = array


def row(observations: Any, i: int) -> Any:
    """Returns a copy of the observation of environment `i`."""
    return tree.map_structure(lambda array: array[i].copy(), observations)


def with_masks(infos: Mapping[str, NDArray], mask: NDArray[np.bool_]) -> dict[str, NDArray]:
    """Returns infos with a fresh copy of the mask `(n,)` under `_key` beside each `key`, as Gymnasium lays them out."""
    laid_out = {}
    # One allocation for all copies.
    copies = np.repeat(mask[np.newaxis], len(infos), axis=0)
    for (key, array), copy in zip(infos.items(), copies, strict=True):
        laid_out[key], laid_out[f"_{key}"] = array, copy
    return laid_out


def masked(infos: Mapping[str, NDArray], mask: NDArray[np.bool_]) -> dict[str, NDArray]:
    """Returns infos with masks, after setting the arrays to 0 or None where the mask `(n,)` is False."""
    for array in infos.values():
        array[~mask] = None if array.dtype == object else 0
    return with_masks(infos, mask)

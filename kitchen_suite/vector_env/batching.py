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


def copied(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Returns nested dicts of arrays with copies of the arrays; faster than dm-tree where there are many."""
    return {key: copied(part) if isinstance(part, dict) else part.copy() for key, part in infos.items()}


def read_only(infos: dict[str, Any]) -> dict[str, Any]:
    """Makes all arrays of nested dicts read-only; returns the dicts."""
    for array in tree.flatten(infos):
        array.flags.writeable = False
    return infos


def fresh_dicts(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Returns copies of nested dicts with the same arrays."""
    return {key: fresh_dicts(part) if isinstance(part, dict) else part for key, part in infos.items()}


def with_masks(infos: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns infos with a fresh copy of the mask `(n,)` under `_key` beside each `key`, as Gymnasium lays them out.

    Dicts among the infos have masks of their own beside each of their keys.
    """
    laid_out: dict[str, Any] = {}
    # One allocation for all copies.
    copies = np.repeat(mask[np.newaxis], len(infos), axis=0)
    for (key, part), copy in zip(infos.items(), copies, strict=True):
        laid_out[key] = with_masks(part, mask) if isinstance(part, dict) else part
        laid_out[f"_{key}"] = copy
    return laid_out


def masked(infos: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns infos with masks, after setting the arrays to 0 or None where the mask `(n,)` is False."""
    for array in tree.flatten(infos):
        array[~mask] = None if array.dtype == object else 0
    return with_masks(infos, mask)

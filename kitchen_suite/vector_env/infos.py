"""Infos of many environments: copies, masks and formats."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import tree
from numpy.typing import NDArray


def copied(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Returns nested dicts of arrays with copies of the arrays; faster than dm-tree where there are many."""
    return {key: copied(part) if isinstance(part, dict) else part.copy() for key, part in infos.items()}


def fresh_dicts(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Returns copies of nested dicts with the same arrays."""
    return {key: fresh_dicts(part) if isinstance(part, dict) else part for key, part in infos.items()}


def with_masks(infos: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns infos with a fresh copy of the mask `(n,)` under `_key` beside each `key`, as Gymnasium has them.

    Dicts among the infos have masks of their own beside each of their keys.
    """
    formatted: dict[str, Any] = {}
    # One allocation for all copies.
    copies = np.repeat(mask[np.newaxis], len(infos), axis=0)
    for (key, part), copy in zip(infos.items(), copies, strict=True):
        formatted[key] = with_masks(part, mask) if isinstance(part, dict) else part
        formatted[f"_{key}"] = copy
    return formatted


def masked(infos: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns infos with masks, after setting the arrays to 0 or None where the mask `(n,)` is False."""
    for array in tree.flatten(infos):
        array[~mask] = None if array.dtype == object else 0
    return with_masks(infos, mask)

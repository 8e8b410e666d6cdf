"""Small things of vectorised environments: random streams, rows of observations, Gymnasium's layout of infos."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def row(observations: Any, i: int) -> Any:
    """A copy of one environment's observation."""
    if isinstance(observations, dict):
        return {key: row(part, i) for key, part in observations.items()}
    return observations[i].copy()


def complete(infos: Mapping[str, NDArray], count: int) -> dict[str, NDArray]:
    """Infos of `count` environments as Gymnasium lays them out: a mask beside each, here True everywhere."""
    laid_out = {}
    for (name, array), mask in zip(infos.items(), np.ones((len(infos), count), bool), strict=True):
        laid_out[name], laid_out[f"_{name}"] = array, mask
    return laid_out


def masked(infos: Mapping[str, NDArray], mask: NDArray[np.bool_]) -> dict[str, NDArray]:
    """Infos likewise of some environments: nothing where the mask is False."""
    laid_out = complete(infos, mask.size)
    for name, array in infos.items():
        array[~mask] = None if array.dtype == object else 0
        laid_out[f"_{name}"][:] = mask
    return laid_out

"""State of an episode in the kitchen."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import Progress
from kitchen_suite.tasks.kitchen.shaping import Shaping


class KitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 59)`, noise of the present observation.
      positions: `(..., 9)`, positions of the robot's joints, without noise [rad, m].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      achieved: `(..., k)`, achieved goals: present positions of the goals' joints, end to end [rad, m, quaternion].
      distances: `(..., n)`, distance of each task from its goal [rad, m].
      progress: completion of the tasks.
      shaping: what dense rewards remember; `()` for the sparse reward.
      terms: `(...)` each, the terms of the last step's dense reward by name; `()` for the sparse reward.
      requested_order: `(..., n)`, place of each task in the order asked, from 0, and -1 where it is not asked; `()` if
        every episode asks for all tasks.
    """

    noise: NDArray[np.float64]
    positions: NDArray[np.float64]
    target: NDArray[np.float64]
    achieved: NDArray[np.float64]
    distances: NDArray[np.float64]
    progress: Progress
    shaping: Shaping | tuple[()] = ()
    terms: dict[str, NDArray[np.float64]] | tuple[()] = ()
    requested_order: NDArray[np.int64] | tuple[()] = ()


def as_dict(state: KitchenState) -> dict[str, Any]:
    """Returns a state as nested dicts of fresh arrays, without the fields that are `()`."""
    parts = {"progress": state.progress._asdict()}
    if isinstance(state.shaping, Shaping):
        parts |= {"shaping": state.shaping._asdict(), "terms": dict(state.terms)}
    nested = {name: {key: np.array(array) for key, array in part.items()} for name, part in parts.items()}
    flat = {name: part for name, part in state._asdict().items() if name not in _NESTED and not isinstance(part, tuple)}
    arrays = {name: np.array(array) for name, array in flat.items()}
    return {**arrays, **nested}


def from_dict(arrays: Mapping[str, Any]) -> KitchenState:
    """Returns the state that `as_dict` returned as nested dicts, among which there may be others."""
    parts = {name: arrays[name] for name in KitchenState._fields if name in arrays}
    if "shaping" in parts:
        parts["shaping"] = Shaping(**parts["shaping"])
    return KitchenState(**{**parts, "progress": Progress(**parts["progress"])})


_NESTED = ("progress", "shaping", "terms")

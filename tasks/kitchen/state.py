"""State of an episode in the kitchen."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import Progress


class KitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 59)`, noise of the present observation.
      positions: `(..., 9)`, positions of the robot's joints, without noise [rad, m].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      achieved: `(..., k)`, achieved goals: present positions of the goals' joints, end to end [rad, m, quaternion].
      distances: `(..., n)`, distance of each task from its goal [rad, m].
      progress: completion of the tasks.
    """

    noise: NDArray[np.float64]
    positions: NDArray[np.float64]
    target: NDArray[np.float64]
    achieved: NDArray[np.float64]
    distances: NDArray[np.float64]
    progress: Progress


def as_dict(state: KitchenState) -> dict[str, Any]:
    """Returns a state as nested dicts of fresh arrays."""
    progress = {name: array.copy() for name, array in state.progress._asdict().items()}
    arrays = {name: np.array(array) for name, array in state._asdict().items() if name != "progress"}
    return {**arrays, "progress": progress}

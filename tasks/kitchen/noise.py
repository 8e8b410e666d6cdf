"""Observation noise of the kitchen: `(ratio * amplitude) * U(-1, 1)`, one draw of 59 numbers per control step."""

from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.scenes.kitchen import in_observed_order

# Amplitudes [rad, m, rad/s, m/s]. The reference takes them from a table for another scene, hence the lack of a pattern.
_ROBOT_POSITIONS = _ROBOT_VELOCITIES = [0.1] * 9
_OBJECT_POSITIONS = {
    "oven": [0.1, *[0.005] * 2, *[0.0005] * 5],
    "hood": [0.0005, 0.005],
    "slide_cabinet": [0.005],
    "hinge_cabinet": [0.005, 0.1],
    "microwave": [0.1],
    "kettle": [0.1, *[0.005] * 3, *[0.1] * 3],
}
_OBJECT_VELOCITIES = {
    "oven": [0.005] * 8,
    "hood": [0.005] * 2,
    "slide_cabinet": [0.005],
    "hinge_cabinet": [0.1] * 2,
    "microwave": [0.1],
    "kettle": [*[0.005] * 3, *[0.1] * 3],
}

AMPLITUDES = np.array(
    [
        *(*_ROBOT_POSITIONS, *_ROBOT_VELOCITIES),
        *(*in_observed_order(_OBJECT_POSITIONS), *in_observed_order(_OBJECT_VELOCITIES)),
    ]
)

# Slices of the observation: robot positions, robot velocities, object positions, object velocities.
SLICES = (slice(0, 9), slice(9, 18), slice(18, 39), slice(39, 59))

# The noise of robot and objects.
PARTS = MappingProxyType({"robot_noise": slice(0, 18), "object_noise": slice(18, 59)})


def scale(*, robot_ratio: float, object_ratio: float) -> NDArray[np.float64]:
    """Returns the greatest noise of each of the 59 elements of the observation, in its unit."""
    ratios = np.full(AMPLITUDES.size, object_ratio)
    ratios[: SLICES[1].stop] = robot_ratio
    return ratios * AMPLITUDES


class AddNoise:
    """A corruptor that adds the present values of an array."""

    def __init__(self, noise: NDArray[np.float64]) -> None:
        """Keeps a reference to `noise`, which the task overwrites at every control step."""
        self._noise = noise

    def __call__(self, observation: NDArray, random_state: np.random.RandomState | None = None) -> NDArray:
        """Returns the noisy observation; draws nothing."""
        del random_state
        return observation + self._noise

"""Maps the kitchen's action (nine joint velocities) to position targets."""

import numpy as np
from numpy.typing import NDArray

# Bounds of commanded velocities [rad/s, m/s] and positions [rad, m]; as in the reference, where they differ a little
# from the joint limits.
VELOCITY_LIMIT = 10.0
POSITION_LOW = np.array([-2.9, -1.8, -2.9, -3.1, -2.9, 0.0, -2.9, 0.0, 0.0])
POSITION_HIGH = np.array([2.9, 1.8, 2.9, 0.0, 2.9, 3.8, 2.9, 0.04, 0.04])


def position_target(
    positions: NDArray[np.float64],
    action: NDArray[np.float64],
    *,
    velocity_scale: float,
    timestep: float,
) -> NDArray[np.float64]:
    """Returns the joint positions to be reached at the end of a control step.

    Args:
      positions: `(..., 9)`, joint positions from which the velocities are integrated [rad, m].
      action: `(..., 9)`, clipped to [-1, 1].
      velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
      timestep: length of the control step [s].

    Returns:
      `(..., 9)` targets of the position actuators [rad, m].
    """
    velocity = np.minimum(np.maximum(action, -1.0), 1.0) * velocity_scale
    if velocity_scale > VELOCITY_LIMIT:
        velocity = np.minimum(np.maximum(velocity, -VELOCITY_LIMIT), VELOCITY_LIMIT)
    return np.minimum(np.maximum(positions + velocity * timestep, POSITION_LOW), POSITION_HIGH)

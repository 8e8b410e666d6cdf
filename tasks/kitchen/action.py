"""Joint velocities in, position targets out: the kitchen's action."""

import numpy as np
from numpy.typing import NDArray

# Velocities the robot may be asked for [rad/s, m/s], and positions [rad, m]; the reference's own bounds, which differ
# a little from the limits of the joints.
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
    """Where the joints should be at the end of a control step.

    Args:
      positions: `(..., 9)`, where they are taken to be at its beginning [rad, m].
      action: `(..., 9)`, clipped to [-1, 1].
      velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
      timestep: length of the control step [s].

    Returns:
      `(..., 9)` targets for the position servos [rad, m].
    """
    velocity = np.minimum(np.maximum(action, -1.0), 1.0) * velocity_scale
    if velocity_scale > VELOCITY_LIMIT:
        velocity = np.minimum(np.maximum(velocity, -VELOCITY_LIMIT), VELOCITY_LIMIT)
    return np.minimum(np.maximum(positions + velocity * timestep, POSITION_LOW), POSITION_HIGH)

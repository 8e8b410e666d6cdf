"""Joint offsets and a wish to close in, servo targets out: the action of the open_cabinet domain."""

import numpy as np
from numpy.typing import NDArray

# Limits of the Panda's seven joints and of its left finger [rad, m].
JOINT_LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973, 0.0])
JOINT_HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973, 0.04])

_ARM_LOW, _ARM_HIGH = JOINT_LOW[:7], JOINT_HIGH[:7]

# Targets of both fingers [m].
GRIPPER_CLOSED = 0.0
GRIPPER_OPEN = 0.04


def arm_target(positions: NDArray[np.float64], action: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the arm's servos should take the joints.

    Args:
      positions: `(..., 7)`, where the joints are [rad].
      action: `(..., 7)`, offsets from there, unbounded [rad].

    Returns:
      `(..., 7)` targets within the joints' limits [rad].
    """
    return np.minimum(np.maximum(positions + action, _ARM_LOW), _ARM_HIGH)


def closing_probability(action: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Probability `(...)` that an action `(...)` closes the gripper: 1 / (1 + exp(-action)), without overflow."""
    return np.exp(-np.logaddexp(0.0, np.negative(action)))


def gripper_target(action: NDArray[np.float64] | float, draw: NDArray[np.float64] | float = 0.5) -> NDArray[np.float64]:
    """Where both fingers should go.

    Args:
      action: `(...)`, unbounded.
      draw: `(...)`, from U(0, 1); its median makes the gripper deterministic: it closes on positive actions.

    Returns:
      `(...)` targets [m]: closed if `draw` is below the probability of closing, else open.
    """
    return np.where(draw < closing_probability(action), GRIPPER_CLOSED, GRIPPER_OPEN)

"""Maps the action of the open_cabinet domain (seven joint offsets, one gripper logit) to position targets."""

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities import PANDA

# Limits of the Panda's seven arm joints and of its left finger [rad, m].
JOINT_LOW, JOINT_HIGH = np.transpose([actuator.range for actuator in PANDA.joint_actuators[:8]]).copy()

_ARM_LOW, _ARM_HIGH = JOINT_LOW[:7], JOINT_HIGH[:7]

# Targets of both fingers [m].
GRIPPER_CLOSED, GRIPPER_OPEN = float(JOINT_LOW[7]), float(JOINT_HIGH[7])


def arm_target(positions: NDArray[np.float64], action: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the targets of the arm's actuators.

    Args:
      positions: `(..., 7)`, present joint positions [rad].
      action: `(..., 7)`, offsets from these positions, unbounded [rad].

    Returns:
      `(..., 7)` targets, clipped to the joint limits [rad].
    """
    return np.minimum(np.maximum(positions + action, _ARM_LOW), _ARM_HIGH)


def closing_probability(action: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Probability `(...)` that a gripper logit `(...)` closes the gripper: 1 / (1 + exp(-logit)), without overflow."""
    return np.exp(-np.logaddexp(0.0, np.negative(action)))


def gripper_target(action: NDArray[np.float64] | float, draw: NDArray[np.float64] | float = 0.5) -> NDArray[np.float64]:
    """Returns the target of both fingers.

    Args:
      action: `(...)`, gripper logit, unbounded.
      draw: `(...)`, from U(0, 1); its median makes the gripper deterministic: it closes on positive logits.

    Returns:
      `(...)` targets [m]: closed if `draw` is below the closing probability, otherwise open.
    """
    return np.where(draw < closing_probability(action), GRIPPER_CLOSED, GRIPPER_OPEN)

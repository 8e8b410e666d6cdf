"""Differential inverse kinematics: damped least squares with joint limits, on arrays with any leading axes `(...)`."""

import numpy as np

from kitchen_suite.tasks import rotations
from kitchen_suite.types import Array

_DAMPING = 0.05  # Near singular configurations, joint steps stay below half of the error divided by it.


def jacobian(position: Array, anchors: Array, axes: Array) -> Array:
    """Returns the Jacobian `(..., 6, k)` of a point's position and orientation in the world, for hinge joints.

    Args:
      position: `(..., 3)`, the point [m].
      anchors: `(..., k, 3)`, a point on each joint's axis [m].
      axes: `(..., k, 3)`, unit vectors along the joints' axes.
    """
    linear = rotations.cross(axes, position[..., np.newaxis, :] - anchors)
    return np.ascontiguousarray(np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2))


def joint_step(jacobian: Array, error: Array, posture: Array, low: Array, high: Array) -> Array:
    """Returns joint steps `(..., k)` that bring the hand nearer to its target.

    The step `x` minimises `|J x - error|^2 + (damping |x - posture|)^2`: in the null space of `J`, it is `posture`.
    Joints that the step would move beyond a limit are put to the limit, and the step is solved again for the others.

    Args:
      jacobian: `(..., m, k)`, `J`.
      error: `(..., m)`, the hand's position error [m], and perhaps its rotation vector [rad].
      posture: `(..., k)`, the step towards the preferred posture.
      low: `(..., k)`, least step of each joint, at most 0.
      high: `(..., k)`, greatest step of each joint, at least 0.
    """
    free, step = np.ones(posture.shape, bool), posture
    regularisation = _DAMPING**2 * np.eye(error.shape[-1])
    # One solution more than joints that may reach a limit in one step.
    for _ in range(4):
        start = np.where(free, posture, step)
        moving = jacobian * free[..., np.newaxis, :]
        transposed = np.ascontiguousarray(np.swapaxes(moving, -1, -2))
        rest = error[..., np.newaxis] - jacobian @ start[..., np.newaxis]
        solved = transposed @ np.linalg.solve(moving @ transposed + regularisation, rest)
        step = np.minimum(np.maximum(start + solved[..., 0], low), high)
        beyond = free & ((step == low) | (step == high))
        # Where no joint is at a limit, another solution would be the same: rows do not depend on one another.
        if not beyond.any():
            break
        free = free & ~beyond
    return step

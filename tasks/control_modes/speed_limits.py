"""Speed limits of hand and joints at the borders of the workspace, on arrays with any leading axes `(...)`.

Near a singular configuration, at a joint's limit or behind an obstacle, the commanded pose runs ahead of the hand, or
small motions of the hand ask for fast joints. Where the arm comes free again, it would catch up at once. Servos with
velocity feedback then reach their greatest torque at small differences of velocity and swing about their velocities,
each at another rate, so that the hand leaves its line.
"""

import numpy as np

from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.control_modes.joints import ArmServos
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.types import Array

# Greatest speeds that are commanded. They are less than the 1.5 times its commanded speed below which the hand is to
# stay, and less than 3 rad/s of a joint, since servos do not reach their velocities at the same time.
_HAND_RATIO = 1.1  # Of the hand, as a multiple of its commanded speed.
_JOINT_SPEED = 2.3  # Of a joint [rad/s].

# Multiple of these speeds beyond which velocities change together.
_FAST = 0.35

# Share to which the torques of light servos count: they swing little, and the arm follows faster without them.
_LIGHT = 0.1


def limited(
    servos: ArmServos, simulation: Simulation, jacobian: Array, velocities: Array, commanded_speed: Array
) -> Array:
    """Returns joint velocities `(..., 7)` that keep hand and joints within their limits [rad/s].

    Velocities beyond the limits are scaled down. Fast ones change in proportion, by what the heavy servos can exert, or
    by what all can while the arm moves beyond the limits.

    Args:
      servos: of the arm.
      simulation: the physics.
      jacobian: `(..., 6, 7)`, of the hand in the world.
      velocities: `(..., 7)`, at which the servos are to move the joints [rad/s].
      commanded_speed: `(...)`, of the hand [m/s].
    """
    present = servos.velocities(simulation)
    asked, actual = (_excess(jacobian, each, commanded_speed) for each in (velocities, present))
    is_fast = np.maximum(asked, actual) > _FAST
    if not is_fast.any():
        return velocities
    change = _scaled(velocities, asked) - present
    share = np.where(servos.light & (actual <= 1.0)[..., np.newaxis], _LIGHT, 1.0)
    load = (servos.load(simulation, change) * share).max(axis=-1)
    slower = present + change / np.maximum(load, 1.0)[..., np.newaxis]
    # An obstacle may have moved the arm beyond the limits.
    slower = _scaled(slower, _excess(jacobian, slower, commanded_speed))
    is_changed = is_fast & (np.maximum(asked, load) > 1.0)
    return np.where(is_changed[..., np.newaxis], slower, velocities)


def _scaled(velocities: Array, excess: Array) -> Array:
    """Returns velocities `(..., 7)` that are scaled down to the limits [rad/s]; `excess` is theirs."""
    return velocities / np.maximum(excess, 1.0)[..., np.newaxis]


def _excess(jacobian: Array, velocities: Array, commanded_speed: Array) -> Array:
    """Returns the greatest ratio `(...)` of the speeds of hand and joints to their limits."""
    # A product of matrices of this size takes several times as long.
    hand = (jacobian[..., :3, :] * velocities[..., np.newaxis, :]).sum(axis=-1)
    ratio = rotations.length(hand)[..., 0] / (_HAND_RATIO * commanded_speed)
    return np.maximum(ratio, np.abs(velocities).max(axis=-1) / _JOINT_SPEED)

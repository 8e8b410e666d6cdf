"""The seven reward terms of the open_cabinet domain, its ends and its success; all on arrays of shape `(..., n)`.

Figures are those of MotrixLab's franka-open-cabinet (Apache-2.0), but for the stage of the penalties, which follows
the environment's published description.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.open_cabinet.action import GRIPPER_OPEN
from kitchen_suite.tasks.open_cabinet.features import Features, scalars

# Names of the terms, in their order; each is a function of this module.
TERMS = ("approach", "orientation", "grasp", "opening", "straddling", "effort", "termination")

# Control steps of an environment's life after which the penalties grow.
LATE_STAGE = 8_000

# Opening from which the drawer counts as open [m].
SUCCESS_OPENING = 0.3

# Distance up to which closing pays [m].
_GRASP_DISTANCE = 0.025

# How far the gripper may reach behind the handle [m], and how fast a joint may move [rad/s, m/s].
_REACH_LIMIT = 0.03
_SPEED_LIMIT = 5.0

# Any finite action is legal, but squares of greater changes than this would be infinite.
_CHANGE_LIMIT = 1e150


class RewardTerms(Protocol):
    """What gives the terms of a step's reward; `reward_terms`, or what is called as it is."""

    def __call__(
        self,
        features: Features,
        *,
        gripper: NDArray[np.float64] | float,
        action_change: NDArray[np.float64],
        total_steps: NDArray[np.int64] | int,
    ) -> dict[str, NDArray[np.float64]]: ...


def approach(features: Features) -> NDArray[np.float64]:
    """`10 * (1 - tanh(d / 0.1))`, `d` the distance from gripper to handle [m]."""
    return 10.0 * (1.0 - np.tanh(features.handle_distance / 0.1))


def alignment(features: Features) -> NDArray[np.float64]:
    """`(...)`, cosine of the angle between gripper and handle frame."""
    # cos(a) = 2 cos(a / 2)^2 - 1
    return 2.0 * features.quaternion_product * features.quaternion_product - 1.0


def orientation(features: Features) -> NDArray[np.float64]:
    """`cos(a)`, `a` the angle between gripper and handle frame; 1 whenever `opening` is positive."""
    return _choose(features.is_held_open, 1.0, alignment(features))


def grasp(features: Features, gripper: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """`(100 if d < 0.025 else -20) * (0.04 - g)`, `g` the target of the fingers [m]."""
    return _choose(features.handle_distance < _GRASP_DISTANCE, 100.0, -20.0) * (GRIPPER_OPEN - gripper)


def opening(features: Features) -> NDArray[np.float64]:
    """`20 * (exp(o) - 1)`, `o` the drawer's position [m] in [0, 1]; 0 when `o > 0` and `d > 0.03`."""
    return _choose(features.is_held_open, 20.0 * np.expm1(np.minimum(features.drawer_position, 1.0)), 0.0)


def straddling(features: Features) -> NDArray[np.float64]:
    """`min(z_left - z_handle, 0) + min(z_handle - z_right, 0)` [m]: left pad above the bar, right pad below it."""
    height = scalars(features.handle_position[..., 2])
    return np.minimum(features.left_pad_height - height, 0.0) + np.minimum(height - features.right_pad_height, 0.0)


def penalty_coefficients(total_steps: NDArray[np.int64] | int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights `(...)` of the action's change and of the joint speeds, after `(...)` control steps of life."""
    late = np.multiply(1.0, total_steps >= LATE_STAGE)
    return 1e-3 * (1.0 + late), 2e-7 * late


def effort(
    features: Features, action_change: NDArray[np.float64], total_steps: NDArray[np.int64] | int
) -> NDArray[np.float64]:
    """`-k_action * |a - a_before|^2 - k_velocity * |v|^2`, `v` the 8 joint velocities; the weights grow once."""
    of_action, of_velocity = penalty_coefficients(total_steps)
    change = np.minimum(np.abs(action_change), _CHANGE_LIMIT)
    return -(of_action * _squared(change) + of_velocity * _squared(features.joint_velocities[..., :8]))


def termination(features: Features) -> NDArray[np.float64]:
    """`-10` on a step that terminates the episode."""
    return _choose(terminates(features), -10.0, 0.0)


def reward_terms(
    features: Features,
    *,
    gripper: NDArray[np.float64] | float,
    action_change: NDArray[np.float64],
    total_steps: NDArray[np.int64] | int,
) -> dict[str, NDArray[np.float64]]:
    """The seven terms by name, in their order; their sum is the reward.

    Args:
      features: the state after the control step.
      gripper: `(...)`, the fingers' target during it [m].
      action_change: `(..., 8)`, its action minus the one before.
      total_steps: `(...)`, control steps of the environment's life before it.

    Returns:
      Arrays of shape `(...)`.
    """
    values = (
        approach(features),
        orientation(features),
        grasp(features, gripper),
        opening(features),
        straddling(features),
        effort(features, action_change, total_steps),
        termination(features),
    )
    return dict(zip(TERMS, values, strict=True))


def terminates(features: Features) -> NDArray[np.bool_]:
    """Whether `(...)` the gripper reaches through the handle, or any of the nine joints moves too fast."""
    behind = scalars(features.handle_offset[..., 0]) > _REACH_LIMIT
    return behind | (np.maximum.reduce(np.abs(features.joint_velocities), axis=-1) > _SPEED_LIMIT)


def _choose(
    condition: NDArray[np.bool_], where_true: NDArray[np.float64] | float, elsewhere: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """`(...)`, one number or the other."""
    return scalars(np.where(condition, where_true, elsewhere))


def _squared(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squares `(...)` of the lengths of vectors `(..., n)`."""
    # The order in memory decides in which order numbers are added: one vector gives what it gives among many.
    return np.add.reduce(np.square(vectors, order="C"), axis=-1)


def succeeds(drawer_position: NDArray[np.float64] | float) -> NDArray[np.bool_]:
    """Whether `(...)` a drawer is open far enough."""
    return np.greater_equal(drawer_position, SUCCESS_OPENING)

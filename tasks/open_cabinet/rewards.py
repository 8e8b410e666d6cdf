"""The seven reward terms of the open_cabinet domain, its termination and its success, on arrays of shape `(..., n)`.

Constants are those of MotrixLab's franka-open-cabinet (Apache-2.0), except for the step at which the penalties grow,
which follows the environment's published description.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.arms.franka import PAD_HALF_SIZE
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.control_modes.joints import GRIPPER_OPEN
from kitchen_suite.tasks.open_cabinet.features import Features, scalars
from kitchen_suite.tasks.terms import RewardTerm
from kitchen_suite.types import Array

# Control steps of a task, over all its episodes, after which the penalties grow.
LATE_STAGE = 8_000

# Least opening that counts as success [m].
SUCCESS_OPENING = 0.3

# Distance from the handle below which closing the gripper is rewarded [m].
_GRASP_DISTANCE = 0.025

# Greatest reach behind the handle [m] and greatest joint speed [rad/s, m/s] without termination.
_REACH_LIMIT = 0.03
_SPEED_LIMIT = 5.0

# Greatest change of an action that enters the reward: any finite action is legal, but its square may overflow.
_CHANGE_LIMIT = 1e150

# Greatest distance from the bar's centre at which it may be held [m].
_GRIP_ALONG = 0.03

# Gap between a pad and the bar at which `Grip.holding` is halved [m]. With the exploration noise of a policy the joint
# offsets shake the bar between closed fingers by some millimetres.
_HALF_HELD = 0.001

# Direction of the bar in its handle's frame.
_BAR_AXIS = np.array([1.0, 0.0, 0.0])


def approach(features: Features) -> Array:
    """`10 * (1 - tanh(d / 0.1))`, `d` the distance from gripper to handle [m]."""
    return 10.0 * (1.0 - np.tanh(features.handle_distance / 0.1))


def alignment(features: Features) -> Array:
    """`(...)`, cosine of the angle between gripper and handle frame."""
    # cos(a) = 2 cos(a / 2)^2 - 1
    return 2.0 * features.quaternion_product * features.quaternion_product - 1.0


def orientation(features: Features) -> Array:
    """`cos(a)`, `a` the angle between gripper and handle frame; 1 whenever `opening` is positive."""
    return scalars(np.where(features.is_held_open, 1.0, alignment(features)))


def grasp(features: Features, gripper: Array | float) -> Array:
    """`(100 if d < 0.025 else -20) * (0.04 - g)`, `g` the target of the fingers [m]."""
    return (np.multiply(120.0, features.handle_distance < _GRASP_DISTANCE) - 20.0) * (GRIPPER_OPEN - gripper)


def opening(features: Features) -> Array:
    """`20 * (exp(o) - 1)`, `o` the drawer's position [m] in [0, 1]; 0 when `o > 0` and `d > 0.03`."""
    position = np.minimum(np.maximum(features.drawer_position, 0.0), 1.0)
    return features.is_held_open * (20.0 * np.expm1(position))


def straddling(features: Features) -> Array:
    """`min(z_left - z_handle, 0) + min(z_handle - z_right, 0)` [m]: left pad above the bar, right pad below it."""
    height = scalars(features.handle_position[..., 2])
    return np.minimum(features.left_pad_height - height, 0.0) + np.minimum(height - features.right_pad_height, 0.0)


def penalty_coefficients(total_steps: NDArray[np.int64] | int) -> tuple[Array, Array]:
    """Returns the weights `(...)` of the action's change and of the joint speeds, after `(...)` total control steps."""
    late = np.multiply(1.0, total_steps >= LATE_STAGE)
    return 1e-3 * (1.0 + late), 2e-7 * late


def effort(features: Features, action_change: Array, total_steps: NDArray[np.int64] | int) -> Array:
    """`-k_action * |a - a_before|^2 - k_velocity * |v|^2`, `v` the 8 joint velocities; the weights grow once."""
    of_action, of_velocity = penalty_coefficients(total_steps)
    change = np.minimum(np.abs(action_change), _CHANGE_LIMIT)
    speeds = rotations.squared_length(features.joint_velocities[..., :8])
    return -(of_action * rotations.squared_length(change) + of_velocity * speeds)


def termination(terminated: NDArray[np.bool_]) -> Array:
    """`-10` on a step that terminates the episode."""
    # The sum makes 0 of the -0 of other steps.
    return 0.0 + np.multiply(-10.0, terminated)


def terminates(features: Features) -> NDArray[np.bool_]:
    """Whether `(...)` the gripper reaches behind the handle, or any of the nine joints moves too fast."""
    behind = scalars(features.handle_offset[..., 0]) > _REACH_LIMIT
    return behind | (np.maximum.reduce(np.abs(features.joint_velocities), axis=-1) > _SPEED_LIMIT)


def succeeds(drawer_position: Array | float) -> NDArray[np.bool_]:
    """Whether `(...)` a drawer is open by 0.3 m or more."""
    return np.greater_equal(drawer_position, SUCCESS_OPENING)


class Grip(NamedTuple):
    """Pose of the bar relative to the finger pads.

    Attributes:
      enclosure: `(...)` in [0, 1], 1 where the bar is between the two pads.
      gap: `(...)`, distance between the bar and the farther pad [m], never negative.
    """

    enclosure: Array
    gap: Array

    @property
    def holding(self) -> Array:
        """`(...)` in [0, 1]: 1 where both pads touch the bar, half of that where one is 1 mm off it."""
        return self.enclosure / (1.0 + self.gap / _HALF_HELD)


def bar_in_gripper_frame(features: Features) -> tuple[Array, Array]:
    """Returns the bar's pose as seen from the gripper.

    Returns:
      `(...)`, distance along the bar from the gripper's nearest point on its axis to its centre, signed [m]; and
      `(..., 3)`, vector from the gripper to that nearest point, in the gripper's frame [m].
    """
    offset = features.handle_offset
    axis = rotations.rotated(features.handle_quaternion, _BAR_AXIS)
    along = np.add.reduce(offset * axis, axis=-1)
    nearest = offset - along[..., np.newaxis] * axis
    return along, rotations.rotated(rotations.inverse(features.tcp_quaternion), nearest)


def grip(features: Features, handle_radius: float) -> Grip:
    """Returns the pose of the bar relative to the finger pads.

    The bar is assumed perpendicular to the gripper's y and z. Otherwise its edges keep the pads a little farther off.

    Args:
      features: the features after the control step.
      handle_radius: radius of the bar [m].
    """
    along, nearest = bar_in_gripper_frame(features)
    fingers, across = features.joint_positions[..., 7:], nearest[..., 1]
    left = fingers[..., 0] - across - handle_radius
    right = fingers[..., 1] + across - handle_radius
    enclosure = _inside(along / _GRIP_ALONG)
    for axis in (0, 2):
        enclosure = enclosure * _inside(nearest[..., axis] / PAD_HALF_SIZE[axis])
    # A pad overlaps the bar by less than half its radius, unless the bar is not between the pads.
    enclosure = enclosure * np.clip(2.0 + np.minimum(left, right) * (2.0 / handle_radius), 0.0, 1.0)
    return Grip(enclosure, np.maximum(np.maximum(left, right), 0.0))


def grasp_orientation(features: Features) -> Array:
    """`4 * cos(a)`, `a` the angle between gripper and handle frame, however far the drawer is open."""
    return 4.0 * alignment(features)


def grip_closing(held: Grip, gripper: Array | float) -> Array:
    """`4 * e * (1 - tanh(s / 0.02)) - 20 * (1 - e) * (0.04 - g)`, `g` the target of the fingers [m]."""
    closing_around = 4.0 * held.enclosure * (1.0 - np.tanh(held.gap / 0.02))
    return closing_around - 20.0 * (1.0 - held.enclosure) * (GRIPPER_OPEN - gripper)


def grasp_opening(features: Features, held: Grip) -> Array:
    """`50 * h * o + 10 * min(v, h * v)`, `o` the drawer's position [m] in [0, 1], `v` how fast it opens [m/s]."""
    holding, velocity = held.holding, features.drawer_velocity
    position = np.minimum(np.maximum(features.drawer_position, 0.0), 1.0)
    # Closing costs in full, held or not, so that opening and closing again and again earns nothing.
    return 50.0 * holding * position + 10.0 * np.minimum(velocity, holding * velocity)


def _inside(share: Array) -> Array:
    """Returns 1 for shares up to two thirds of the way from the middle to the end, falling linearly to 0 at the end."""
    return np.clip(3.0 * (1.0 - np.abs(share)), 0.0, 1.0)


class RewardedState(Protocol):
    """The state before or after a control step, as far as terms of the reward read it.

    Attributes:
      previous_action: `(..., k)`, action of the last step.
      terminates: `(...)`, whether the last step terminated the episode.
      total_steps: `(...)`, control steps so far, over all episodes.
    """

    @property
    def previous_action(self) -> Array: ...

    @property
    def terminates(self) -> NDArray[np.bool_]: ...

    @property
    def total_steps(self) -> NDArray[np.int64]: ...


class OpenCabinetStep(Protocol):
    """A control step, as far as terms of the reward read it.

    Attributes:
      before: the state before the step.
      action: `(..., k)`, the action.
      after: the state after the step.
      features: after the step.
      grip: pose of the bar relative to the finger pads after the step.
      gripper: `(...)`, target of the fingers during the step [m].
    """

    @property
    def before(self) -> RewardedState: ...

    @property
    def action(self) -> Array: ...

    @property
    def after(self) -> RewardedState: ...

    @property
    def features(self) -> Features: ...

    @property
    def grip(self) -> Grip: ...

    @property
    def gripper(self) -> Array: ...


def _term(formula: Callable[[Features], Array]) -> RewardTerm[OpenCabinetStep]:
    """Returns the term of a reward that depends on the features after the step alone."""
    return lambda step: formula(step.features)


# The change may be infinite; the term bounds it.
@np.errstate(over="ignore")
def _effort_term(step: OpenCabinetStep) -> Array:
    return effort(step.features, step.action - step.before.previous_action, step.before.total_steps)


_ORIGINAL: Mapping[str, RewardTerm[OpenCabinetStep]] = {
    "approach": _term(approach),
    "orientation": _term(orientation),
    "grasp": lambda step: grasp(step.features, step.gripper),
    "opening": _term(opening),
    "straddling": _term(straddling),
    "effort": _effort_term,
    "termination": lambda step: termination(step.after.terminates),
}

# Pays for opening only while both pads hold the bar.
_GRASP: Mapping[str, RewardTerm[OpenCabinetStep]] = {
    **_ORIGINAL,
    "orientation": _term(grasp_orientation),
    "grasp": lambda step: grip_closing(step.grip, step.gripper),
    "opening": lambda step: grasp_opening(step.features, step.grip),
}

REWARDS: Mapping[str, Mapping[str, RewardTerm[OpenCabinetStep]]] = MappingProxyType(
    {
        "original": MappingProxyType(_ORIGINAL),
        "grasp": MappingProxyType(_GRASP),
    }
)
"""The terms of each reward, by the names of reward and term, in the order in which they are added."""

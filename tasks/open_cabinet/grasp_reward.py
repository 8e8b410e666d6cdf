"""Reward of the open_cabinet domain that pays for opening a drawer only while both pads hold its bar.

Its terms have the names in `reward.TERMS`. Four terms are those of the original reward; the other three are functions
of this module. Whether the bar is held is computed from the finger positions: the actuators press both pads on the bar,
and a little into it. A bar that is dragged with one finger is out of the other finger's reach, and a pad that meets no
bar moves past it.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.robots.panda import PAD_HALF_SIZE
from kitchen_suite.tasks.control_modes.joint_offset import GRIPPER_OPEN
from kitchen_suite.tasks.open_cabinet import reward, rotations
from kitchen_suite.tasks.open_cabinet.features import Features

# Greatest distance from the bar's centre at which it may be held [m].
_GRIP_ALONG = 0.03

# Gap between a pad and the bar at which `Grip.holding` is halved [m]. With the exploration noise of a policy the joint
# offsets shake the bar between closed fingers by some millimetres.
_HALF_HELD = 0.001

# Direction of the bar in its handle's frame.
_BAR_AXIS = np.array([1.0, 0.0, 0.0])


class Grip(NamedTuple):
    """Pose of the bar relative to the finger pads.

    Attributes:
      enclosure: `(...)` in [0, 1], 1 where the bar is between the two pads.
      gap: `(...)`, distance between the bar and the farther pad [m], never negative.
    """

    enclosure: NDArray[np.float64]
    gap: NDArray[np.float64]

    @property
    def holding(self) -> NDArray[np.float64]:
        """`(...)` in [0, 1]: 1 where both pads touch the bar, half of that where one is 1 mm off it."""
        return self.enclosure / (1.0 + self.gap / _HALF_HELD)


def bar_in_gripper_frame(features: Features) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the bar's pose as seen from the gripper.

    Returns:
      `(...)`, distance along the bar from the gripper's nearest point on its axis to its centre, signed [m]; and
      `(..., 3)`, vector from the gripper to that nearest point, in the gripper's frame [m].
    """
    offset = features.handle_offset
    axis = rotations.rotate(features.handle_quaternion, _BAR_AXIS)
    along = np.add.reduce(offset * axis, axis=-1)
    nearest = offset - along[..., np.newaxis] * axis
    return along, rotations.rotate(rotations.inverse(features.tcp_quaternion), nearest)


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


def orientation(features: Features) -> NDArray[np.float64]:
    """`4 * cos(a)`, `a` the angle between gripper and handle frame, however far the drawer is open."""
    return 4.0 * reward.alignment(features)


def grasp(held: Grip, gripper: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """`4 * e * (1 - tanh(s / 0.02)) - 20 * (1 - e) * (0.04 - g)`, `g` the target of the fingers [m]."""
    closing_around = 4.0 * held.enclosure * (1.0 - np.tanh(held.gap / 0.02))
    return closing_around - 20.0 * (1.0 - held.enclosure) * (GRIPPER_OPEN - gripper)


def opening(features: Features, held: Grip) -> NDArray[np.float64]:
    """`50 * h * o + 10 * min(v, h * v)`, `o` the drawer's position [m] in [0, 1], `v` how fast it opens [m/s]."""
    holding, velocity = held.holding, features.drawer_velocity
    position = np.minimum(np.maximum(features.drawer_position, 0.0), 1.0)
    # Closing costs in full, held or not, so that opening and closing again and again earns nothing.
    return 50.0 * holding * position + 10.0 * np.minimum(velocity, holding * velocity)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GraspReward:
    """Reward function for a bar of a given size; its signature is `reward.RewardTerms`.

    Attributes:
      handle_radius: radius of the bar [m].
    """

    handle_radius: float

    def __call__(
        self,
        features: Features,
        *,
        gripper: NDArray[np.float64] | float,
        action_change: NDArray[np.float64],
        total_steps: NDArray[np.int64] | int,
        terminated: NDArray[np.bool_],
    ) -> dict[str, NDArray[np.float64]]:
        """Returns the seven terms by name; arguments as in `reward.reward_terms`."""
        held = grip(features, self.handle_radius)
        values = (
            reward.approach(features),
            orientation(features),
            grasp(held, gripper),
            opening(features, held),
            reward.straddling(features),
            reward.effort(features, action_change, total_steps),
            reward.termination(terminated),
        )
        return dict(zip(reward.TERMS, values, strict=True))


def _inside(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns 1 for shares up to two thirds of the way from the middle to the end, falling linearly to 0 at the end."""
    return np.clip(3.0 * (1.0 - np.abs(share)), 0.0, 1.0)

"""A reward of the open_cabinet domain that pays for opening a drawer by its bar, held between both pads.

It has the names of `drawer_reward.TERMS`; four of the terms are the same, those that are functions of this module are
not. Whether the bar is held follows from where the fingers are: servos press both pads on it, a little into it. A bar
that is dragged with one finger is out of the other finger's reach, and a pad that has nothing to stop it goes beyond.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.robots.panda import PAD_HALF_SIZE
from kitchen_suite.tasks.open_cabinet import reward as drawer_reward
from kitchen_suite.tasks.open_cabinet.action import GRIPPER_OPEN
from kitchen_suite.tasks.open_cabinet.features import Features

# How far from its middle the bar may be held [m].
_GRIP_ALONG = 0.03

# How far off the bar a pad halves the holding [m]: joint offsets with the noise of a policy that explores shake the bar
# between closed fingers by some millimetres.
_HALF_HELD = 0.001

# The bar in its handle's frame.
_BAR_AXIS = np.array([1.0, 0.0, 0.0])

# Makes of a quaternion w, x, y, z that of the inverse rotation.
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])

# From x, y, z to the two axes that follow each.
_NEXT, _AFTER_NEXT = [1, 2, 0], [2, 0, 1]


class Grip(NamedTuple):
    """How the bar lies in the gripper.

    Attributes:
      enclosure: `(...)` in [0, 1], 1 where the bar is between the two pads.
      gap: `(...)`, free space between the bar and the pad that is farther from it [m], never negative.
    """

    enclosure: NDArray[np.float64]
    gap: NDArray[np.float64]

    @property
    def holding(self) -> NDArray[np.float64]:
        """`(...)` in [0, 1]: 1 where both pads are on the bar, half that where one is 1 mm off it."""
        return self.enclosure / (1.0 + self.gap / _HALF_HELD)


def grip(features: Features, handle_radius: float) -> Grip:
    """How the bar lies in the gripper.

    The bar is taken to be across the gripper's y and z. Where it is not, its edges keep the pads a little farther off.

    Args:
      features: the state after the control step.
      handle_radius: of the bar [m].
    """
    offset = features.handle_offset
    bar = _rotated(features.handle_quaternion, _BAR_AXIS)
    along = np.add.reduce(offset * bar, axis=-1)
    # From the gripper the shortest way to the bar's axis, in the gripper's frame.
    nearest = _rotated(features.tcp_quaternion * _CONJUGATE, offset - along[..., np.newaxis] * bar)
    fingers, across = features.joint_positions[..., 7:], nearest[..., 1]
    left, right = fingers[..., 0] - across - handle_radius, fingers[..., 1] + across - handle_radius
    enclosure = _inside(along / _GRIP_ALONG)
    for axis in (0, 2):
        enclosure = enclosure * _inside(nearest[..., axis] / PAD_HALF_SIZE[axis])
    # Pads are never as far in the bar as half its radius, unless there is no bar between them.
    enclosure = enclosure * np.clip(2.0 + np.minimum(left, right) * (2.0 / handle_radius), 0.0, 1.0)
    return Grip(enclosure, np.maximum(np.maximum(left, right), 0.0))


def orientation(features: Features) -> NDArray[np.float64]:
    """`4 * cos(a)`, `a` the angle between gripper and handle frame, however far the drawer is open."""
    return 4.0 * drawer_reward.alignment(features)


def grasp(held: Grip, gripper: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """`4 * e * (1 - tanh(s / 0.02)) - 20 * (1 - e) * (0.04 - g)`, `g` the target of the fingers [m]."""
    closing_around = 4.0 * held.enclosure * (1.0 - np.tanh(held.gap / 0.02))
    return closing_around - 20.0 * (1.0 - held.enclosure) * (GRIPPER_OPEN - gripper)


def opening(features: Features, held: Grip) -> NDArray[np.float64]:
    """`50 * h * o + 10 * min(v, h * v)`, `o` the drawer's position [m] in [0, 1], `v` how fast it opens [m/s]."""
    holding, velocity = held.holding, features.drawer_velocity
    position = np.minimum(np.maximum(features.drawer_position, 0.0), 1.0)
    # What closes it costs in full, so that opening and closing it again and again earns nothing.
    return 50.0 * holding * position + 10.0 * np.minimum(velocity, holding * velocity)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GraspReward:
    """The reward for a bar of a given size; called as `drawer_reward.reward_terms` is.

    Attributes:
      handle_radius: of the bar [m].
    """

    handle_radius: float

    def __call__(
        self,
        features: Features,
        *,
        gripper: NDArray[np.float64] | float,
        action_change: NDArray[np.float64],
        total_steps: NDArray[np.int64] | int,
    ) -> dict[str, NDArray[np.float64]]:
        """The seven terms by name; see `drawer_reward.reward_terms`."""
        held = grip(features, self.handle_radius)
        values = (
            drawer_reward.approach(features),
            orientation(features),
            grasp(held, gripper),
            opening(features, held),
            drawer_reward.straddling(features),
            drawer_reward.effort(features, action_change, total_steps),
            drawer_reward.termination(features),
        )
        return dict(zip(drawer_reward.TERMS, values, strict=True))


def _rotated(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors `(..., 3)`, rotated by quaternions `(..., 4)` of length 1."""
    scalar, axis = quaternion[..., :1], quaternion[..., 1:]
    turn = 2.0 * _cross(axis, vector)
    return vector + scalar * turn + _cross(axis, turn)


def _cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    # Several times as fast as numpy.cross.
    return one[..., _NEXT] * other[..., _AFTER_NEXT] - one[..., _AFTER_NEXT] * other[..., _NEXT]


def _inside(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 up to two thirds of the way from the middle to the end, 0 at the end."""
    return np.clip(3.0 * (1.0 - np.abs(share)), 0.0, 1.0)

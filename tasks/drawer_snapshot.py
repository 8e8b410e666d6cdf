"""What there is to know about a gripper and a drawer at one moment; all that observation and reward are made of."""

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class Snapshot:
    """Positions and velocities after a control step; arrays of shape `(..., n)`, positions in the world's frame.

    Attributes:
      joint_positions: `(..., 9)`, the arm's seven joints [rad], left and right finger [m].
      joint_velocities: `(..., 9)`, likewise [rad/s, m/s].
      tcp_position: `(..., 3)`, the point between the finger tips [m].
      tcp_quaternion: `(..., 4)`, w, x, y, z; z is the direction of approach, y points to the left finger.
      handle_position: `(..., 3)`, middle of the drawer's bar [m].
      handle_quaternion: `(..., 4)`, w, x, y, z; equal to the gripper's when it holds the bar from the front.
      left_pad_height: `(...)`, z of the left finger's pad [m].
      right_pad_height: `(...)`, z of the right finger's pad [m].
      drawer_position: `(...)`, 0 when closed, positive when open [m].
      drawer_velocity: `(...)`, positive when opening [m/s].
    """

    joint_positions: NDArray[np.float64]
    joint_velocities: NDArray[np.float64]
    tcp_position: NDArray[np.float64]
    tcp_quaternion: NDArray[np.float64]
    handle_position: NDArray[np.float64]
    handle_quaternion: NDArray[np.float64]
    left_pad_height: NDArray[np.float64]
    right_pad_height: NDArray[np.float64]
    drawer_position: NDArray[np.float64]
    drawer_velocity: NDArray[np.float64]

    @functools.cached_property
    def handle_distance(self) -> NDArray[np.float64]:
        """`(...)`, from the point between the finger tips to the handle [m]."""
        return np.sqrt(np.square(self.handle_position - self.tcp_position).sum(axis=-1))

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Copies of all attributes by name; `Snapshot(**arrays)` is the same snapshot."""
        return {field.name: np.array(getattr(self, field.name)) for field in dataclasses.fields(self)}

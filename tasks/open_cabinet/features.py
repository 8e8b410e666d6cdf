"""Physics features of robot, handle and drawer, from which observation and reward are computed, and their sensors."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Self

import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike

from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.tasks.sensors import FeatureSensors
from kitchen_suite.tasks.terms import end_to_end
from kitchen_suite.types import Array

_HOLD_DISTANCE = 0.03  # Greatest distance of the hand from the handle that it holds [m].

# Sizes of the parts that are vectors.
_VECTORS = {
    "joint_positions": 9,
    "joint_velocities": 9,
    "tcp_position": 3,
    "tcp_quaternion": 4,
    "handle_position": 3,
    "handle_quaternion": 4,
}

# The parts that are numbers, which have no axis.
_SCALARS = ("left_pad_height", "right_pad_height", "drawer_position", "drawer_velocity")

_PLACES = end_to_end({**_VECTORS, **dict.fromkeys(_SCALARS, 1)})

# Index of each part in `Features.values`: a slice of vectors, an integer of numbers.
FEATURE_INDICES: Mapping[str, slice | int] = MappingProxyType(
    {name: place.start if name in _SCALARS else place for name, place in _PLACES.items()}
)
FEATURES_SIZE = _PLACES["drawer_velocity"].stop

_HEIGHT = slice(2, 3)


def scalars(values: Array) -> Array:
    """Returns values `(...)`; a 0-d array becomes a scalar, with which numpy computes several times as fast."""
    return values[()]


class Features:
    """Positions and velocities after a control step, in the world frame; the parts are views of one array.

    Attributes:
      values: `(..., 36)`, all parts end to end, in the order of `FEATURE_INDICES`.
      joint_positions: `(..., 9)`, of the arm's seven joints [rad], left and right finger [m].
      joint_velocities: `(..., 9)`, of the arm's seven joints [rad/s], left and right finger [m/s].
      tcp_position: `(..., 3)`, tool centre point, the point between the finger tips [m].
      tcp_quaternion: `(..., 4)`, gripper orientation w, x, y, z; z is the direction of approach, y points to the left
        finger.
      handle_position: `(..., 3)`, centre of the handle's bar [m].
      handle_quaternion: `(..., 4)`, handle orientation w, x, y, z; equal to the gripper's when it holds the bar from
        the front.
      left_pad_height: `(...)`, z of the left finger's pad [m].
      right_pad_height: `(...)`, z of the right finger's pad [m].
      drawer_position: `(...)`, opening of the drawer, 0 when closed [m].
      drawer_velocity: `(...)`, velocity of the drawer, positive when opening [m/s].
      handle_offset: `(..., 3)`, vector from the point between the finger tips to the handle, in the world frame [m].
      handle_distance: `(...)`, its length [m].
      quaternion_product: `(...)`, inner product of the two orientations, plus or minus the cosine of half the angle
        between them.
      is_held_open: `(...)`, whether the drawer is open, and the gripper within 0.03 m of its handle.
    """

    def __init__(self, values: Array) -> None:
        """Wraps `values`, without a copy."""
        self.values = values
        parts = FEATURE_INDICES
        self.joint_positions = values[..., parts["joint_positions"]]
        self.joint_velocities = values[..., parts["joint_velocities"]]
        self.tcp_position = values[..., parts["tcp_position"]]
        self.tcp_quaternion = values[..., parts["tcp_quaternion"]]
        self.handle_position = values[..., parts["handle_position"]]
        self.handle_quaternion = values[..., parts["handle_quaternion"]]
        self.left_pad_height = scalars(values[..., parts["left_pad_height"]])
        self.right_pad_height = scalars(values[..., parts["right_pad_height"]])
        self.drawer_position = scalars(values[..., parts["drawer_position"]])
        self.drawer_velocity = scalars(values[..., parts["drawer_velocity"]])
        self.handle_offset: Array = self.handle_position - self.tcp_position
        self.handle_distance = np.sqrt(np.add.reduce(np.square(self.handle_offset), axis=-1))
        self.quaternion_product = np.add.reduce(self.handle_quaternion * self.tcp_quaternion, axis=-1)
        self.is_held_open = (self.drawer_position > 0.0) & (self.handle_distance <= _HOLD_DISTANCE)

    @classmethod
    def of(cls, **parts: ArrayLike) -> Self:
        """Returns the features with the given parts, all of them by name."""
        arrays = [np.asarray(parts[name], np.float64) for name in FEATURE_INDICES]
        has_axis = [isinstance(index, slice) for index in FEATURE_INDICES.values()]
        columns = [array if axis else array[..., np.newaxis] for array, axis in zip(arrays, has_axis, strict=True)]
        return cls(np.concatenate(columns, axis=-1))

    def arrays(self) -> dict[str, Array]:
        """Returns copies of all parts by name, from which `Features.of` makes equal features."""
        return {name: np.array(self.values[..., index]) for name, index in FEATURE_INDICES.items()}


class OpenCabinetSensors(FeatureSensors):
    """Sensors of robot, handle and drawer, in the order of `FEATURE_INDICES`.

    Attributes:
      slide: joint of the drawer.
    """

    def __init__(self, scene: OpenCabinetScene, drawer: str) -> None:
        """Adds the sensors.

        Args:
          scene: robot and cabinet; not yet compiled.
          drawer: `top` or `bottom`.
        """
        super().__init__(scene.arena.mjcf_model, scene.robot)
        joints = scene.robot.joints
        self.slide = scene.cabinet.drawer_joint(drawer)
        gripper, handle = scene.robot.end_effector, scene.cabinet.handle_site(drawer)
        left_pad, right_pad = scene.robot.pads
        self.add_joints("joint_positions", "jointpos", joints)
        self.add_joints("joint_velocities", "jointvel", joints)
        self.add_frame("tcp_position", "framepos", gripper)
        self.add_frame("tcp_quaternion", "framequat", gripper)
        self.add_frame("handle_position", "framepos", handle)
        self.add_frame("handle_quaternion", "framequat", handle)
        self.add_frame("left_pad_height", "framepos", left_pad, _HEIGHT)
        self.add_frame("right_pad_height", "framepos", right_pad, _HEIGHT)
        self.add_joints("drawer_position", "jointpos", (self.slide,))
        self.add_joints("drawer_velocity", "jointvel", (self.slide,))

    def bind(self, physics: mjcf.Physics) -> None:
        super().bind(physics)
        if self.indices != _PLACES:
            raise ValueError(f"the sensors read the features {self.indices}, which must be {dict(_PLACES)}")

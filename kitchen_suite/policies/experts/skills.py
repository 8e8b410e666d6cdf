"""Skills as data: poses of the hand, speeds, and opening of the fingers."""

import dataclasses
from typing import Self

import mink
import numpy as np
from numpy.typing import ArrayLike

from kitchen_suite.types import Array, Vector

# Opening of each finger [m].
OPEN, CLOSED = 0.04, 0.0

UNLIMITED = 10.0  # Faster than any joint can move the hand [m/s, rad/s].


def vector(array: ArrayLike) -> Vector:
    """Returns an array `(3,)` as numbers, of which skills are made so that they are hashable."""
    x, y, z = np.asarray(array).tolist()
    return x, y, z


@dataclasses.dataclass(frozen=True, kw_only=True)
class HandOrientation:
    """Orientation of the hand in the frame of its skill.

    Attributes:
      approach: direction in which the fingers point, of length 1.
      spread: direction in which the left finger opens; made orthogonal to `approach`.
    """

    approach: Vector
    spread: Vector

    def standoff_position(self, point: Vector, distance: float) -> Vector:
        """Position of the hand's site at a distance [m] from a point at which the fingers point."""
        return vector(np.array(point) - distance * np.array(self.approach))

    @classmethod
    def from_rotation(cls, rotation: mink.SO3) -> Self:
        """Orientation of a hand whose site has a rotation in the frame of the skill."""
        _, y, z = rotation.as_matrix().T.tolist()
        return cls(approach=tuple(z), spread=tuple(y))

    @property
    def rotation(self) -> mink.SO3:
        """Rotation of the hand's site: its z axis is `approach`, its y axis points to the left finger."""
        z = np.array(self.approach)
        y = np.array(self.spread) - np.dot(self.spread, z) * z
        y /= np.linalg.norm(y)
        return mink.SO3.from_matrix(np.stack([np.cross(y, z), y, z], axis=1))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Move:
    """Motion of the hand's site (`end_effector` in the kitchen, `gripper` at the cabinet) along a straight line.

    Attributes:
      position: target position of the site, in the frame of the skill [m].
      orientation: target orientation of the hand.
      fingers: opening of each finger during the motion [m].
      speed: greatest speed of the site [m/s].
      settle_steps: control steps to stay at the target.
      in_free_space: whether no object is near the target, so that jitter may displace it.
    """

    position: Vector
    orientation: HandOrientation
    fingers: float = CLOSED
    speed: float = UNLIMITED
    settle_steps: int = 0
    in_free_space: bool = False

    @property
    def pose(self) -> mink.SE3:
        """Target pose of the site, in the frame of the skill."""
        return mink.SE3.from_rotation_and_translation(self.orientation.rotation, np.array(self.position))

    def turned(self, rotation: mink.SO3, pivot: Array) -> Self:
        """This motion with its target turned about a point `(3,)` [m]."""
        position = pivot + rotation.apply(np.array(self.position) - pivot)
        orientation = HandOrientation.from_rotation(rotation @ self.orientation.rotation)
        return dataclasses.replace(self, position=tuple(position.tolist()), orientation=orientation)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArcMove:
    """Motion of the hand's site around the axis of a revolute joint, which turns with it.

    Attributes:
      angle: target angle of the joint [rad].
      hand_rotation_ratio: rotation of the hand about the axis, relative to the joint's.
      fingers: opening of each finger [m].
      speed: greatest speed of the joint [rad/s].
    """

    angle: float
    hand_rotation_ratio: float = 0.0
    fingers: float = CLOSED
    speed: float = UNLIMITED


@dataclasses.dataclass(frozen=True, kw_only=True)
class Revolute:
    """A joint about which an object rotates.

    Attributes:
      elements: index of its angle [rad] among the positions of the joints of the task's goal.
      anchor: a point on the axis, in the world [m].
      axis: direction of the axis, in the world.
    """

    elements: tuple[int, ...]
    anchor: Vector
    axis: Vector

    def displacement(self, position: Array) -> mink.SE3:
        """Transform that takes the object from angle 0 to an angle `(1,)` [rad]."""
        anchor, rotation = np.array(self.anchor), mink.SO3.exp(position[0] * np.array(self.axis))
        return mink.SE3.from_rotation_and_translation(rotation, anchor - rotation.apply(anchor))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prismatic:
    """A joint along which an object translates: along x, or along x, y and z.

    Attributes:
      elements: indices of its one or three coordinates among the positions of the joints of the task's goal.
      initial_position: the coordinates at the start of an episode [m].
    """

    elements: tuple[int, ...]
    initial_position: tuple[float, ...]

    def displacement(self, position: Array) -> mink.SE3:
        """Transform that takes the object from its initial position to a position `(1,)` or `(3,)` [m]."""
        return mink.SE3.from_translation(np.pad(position - self.initial_position, (0, 3 - position.size)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Skill:
    """Motions of the hand that complete one task.

    Attributes:
      moves: the motions in order; an `ArcMove` needs a revolute `object_joint`.
      ik_seed: joint positions from which inverse kinematics solves the first motion [rad]; every later motion starts
        from the solution before it.
      object_joint: joint of the object that the hand moves, along with which the poses move. None if the poses are
        fixed in the skill's frame.
      retreat: displacement of the site when the hand leaves, in the world [m].
      release_steps: control steps to open the fingers before the hand leaves; 0 where they hold nothing.
    """

    moves: tuple[Move | ArcMove, ...]
    ik_seed: tuple[float, ...]
    object_joint: Revolute | Prismatic | None = None
    retreat: Vector = (0.0, 0.0, 0.0)
    release_steps: int = 0

    @property
    def lines(self) -> tuple[Move, ...]:
        """The straight motions; all skills begin with one."""
        return tuple(move for move in self.moves if isinstance(move, Move))

    def with_orientation(self, orientation: HandOrientation) -> Self:
        """This skill with the same orientation of the hand in all moves."""
        moves: list[Move | ArcMove] = []
        for move in self.moves:
            changes = {"orientation": orientation} if isinstance(move, Move) else {"hand_rotation_ratio": 0.0}
            moves.append(dataclasses.replace(move, **changes))
        return dataclasses.replace(self, moves=tuple(moves))

    def turned(self, angle: float) -> Self:
        """This skill with the hand turned about the vertical through the point of its last straight motion [rad].

        An arc keeps the hand as it grasped.
        """
        turn, pivot = mink.SO3.from_z_radians(angle), np.array(self.lines[-1].position)
        moves = (move.turned(turn, pivot) if isinstance(move, Move) else move for move in self.moves)
        return dataclasses.replace(self, moves=tuple(moves))

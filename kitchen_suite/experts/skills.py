"""Skills as data: where the hand goes, how fast, and what the fingers do there."""

import dataclasses
from typing import Self

import mink
import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]

# Directions in the world of the kitchen, whose robot looks along y.
FORWARD: Vector = (0.0, 1.0, 0.0)
RIGHT: Vector = (1.0, 0.0, 0.0)
LEFT: Vector = (-1.0, 0.0, 0.0)
DOWN: Vector = (0.0, 0.0, -1.0)

# How far each finger is to be open [m].
OPEN, CLOSED = 0.04, 0.0

# Faster than any joint can move the hand [m/s].
UNLIMITED = 10.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Move:
    """Takes the site between the fingers to a place.

    Attributes:
      to: where, while the thing that is to be moved is where it starts [m].
      approach: direction in which the fingers point.
      spread: direction in which the left finger opens; made orthogonal to `approach`.
      fingers: how far each is to be open [m].
      straight: whether the site moves along a straight line; else the joints take the shortest way.
      speed: of the site, at most [m/s].
      settle: control steps to stay there.
      free: whether this is a way through free space, which may as well be a little beside.
    """

    to: Vector
    approach: Vector = FORWARD
    spread: Vector = RIGHT
    fingers: float = CLOSED
    straight: bool = True
    speed: float = UNLIMITED
    settle: int = 0
    free: bool = False

    @property
    def pose(self) -> mink.SE3:
        """Of the site between the fingers: z is the direction of approach, y the one of the left finger."""
        z = np.array(self.approach) / np.linalg.norm(self.approach)
        y = np.array(self.spread) - np.dot(self.spread, z) * z
        y /= np.linalg.norm(y)
        rotation = mink.SO3.from_matrix(np.stack([np.cross(y, z), y, z], axis=1))
        return mink.SE3.from_rotation_and_translation(rotation, np.array(self.to))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Swing:
    """Leads the site round the axis of the thing that is to be turned.

    Attributes:
      to: angle of the thing at the end [rad].
      twist: share of the way by which the hand turns too.
      fingers: how far each is to be open [m].
      speed: at most [rad/s].
    """

    to: float
    twist: float = 1.0
    fingers: float = CLOSED
    speed: float = UNLIMITED


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hinge:
    """How a thing turns.

    Attributes:
      element: where its angle [rad] stands in the 21 object positions.
      about: a point of the axis [m].
      axis: direction of the axis.
    """

    element: int
    about: Vector
    axis: Vector

    def value(self, objects: NDArray[np.float64]) -> NDArray[np.float64]:
        """Angle `(1,)` [rad], from the object positions `(21,)`."""
        return objects[[self.element]]

    def displacement(self, value: NDArray[np.float64], twist: float = 1.0) -> mink.SE3:
        """How far the thing has moved from where it starts."""
        centre, turn = np.array(self.about), mink.SO3.exp(float(value[0]) * np.array(self.axis))
        return mink.SE3.from_rotation_and_translation(turn, centre - turn.apply(centre))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Slide:
    """How a thing shifts.

    Attributes:
      elements: where its three coordinates, or the one along x, stand in the 21 object positions.
      start: their values at the start [m].
    """

    elements: tuple[int, ...]
    start: tuple[float, ...]

    def value(self, objects: NDArray[np.float64]) -> NDArray[np.float64]:
        """Shift `(k,)` [m], from the object positions `(21,)`."""
        return objects[list(self.elements)] - self.start

    def displacement(self, value: NDArray[np.float64]) -> mink.SE3:
        """How far the thing has moved from where it starts."""
        return mink.SE3.from_translation(np.pad(value, (0, 3 - value.size)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Skill:
    """One task's motions.

    Attributes:
      steps: the motions, one after the other.
      posture: joint positions near which those of all steps are sought [rad].
      thing: how the thing moves that the steps go along with.
      retreat: displacement of the site when it leaves [m].
      release: control steps to open the fingers before that; none where they hold nothing.
    """

    steps: tuple[Move | Swing, ...]
    posture: tuple[float, ...]
    thing: Hinge | Slide | None = None
    retreat: Vector = (0.0, 0.0, 0.0)
    release: int = 0

"""Skills as data: where the hand goes, how fast, and what the fingers do there."""

import dataclasses

import mink
import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]

# How far each finger is to be open [m].
OPEN, CLOSED = 0.04, 0.0

# Faster than any joint can move the hand [m/s, rad/s].
UNLIMITED = 10.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class HandOrientation:
    """How the hand is turned, in the frame of its skill.

    Attributes:
      approach: direction in which the fingers point, of length 1.
      spread: direction in which the left finger opens; made orthogonal to `approach`.
    """

    approach: Vector
    spread: Vector

    def before(self, point: Vector, distance: float) -> Vector:
        """Where the hand's site is so that a point lies so far before it [m]."""
        x, y, z = np.array(point) - distance * np.array(self.approach)
        return float(x), float(y), float(z)

    @property
    def rotation(self) -> mink.SO3:
        """Of the site: z is the direction of approach, y the one of the left finger."""
        z = np.array(self.approach)
        y = np.array(self.spread) - np.dot(self.spread, z) * z
        y /= np.linalg.norm(y)
        return mink.SO3.from_matrix(np.stack([np.cross(y, z), y, z], axis=1))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Move:
    """Takes the hand's site (the kitchen's `end_effector`, the cabinet's `gripper`) to a place.

    Attributes:
      to: where, in the frame of the skill [m].
      hand: how the hand is turned there.
      fingers: how far each is to be open on the way [m].
      speed: of the site, at most [m/s].
      settle: control steps to stay there.
      free: whether nothing is near, so that it may as well be a little beside.
    """

    to: Vector
    hand: HandOrientation
    fingers: float = CLOSED
    speed: float = UNLIMITED
    settle: int = 0
    free: bool = False

    @property
    def pose(self) -> mink.SE3:
        """Of the site, in the frame of the skill."""
        return mink.SE3.from_rotation_and_translation(self.hand.rotation, np.array(self.to))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArcMove:
    """Leads the site round the axis of the thing that is to be turned.

    Attributes:
      to: angle of the thing at the end [rad].
      twist: share of the way by which the hand turns too.
      fingers: how far each is to be open [m].
      speed: of the thing, at most [rad/s].
    """

    to: float
    twist: float = 0.0
    fingers: float = CLOSED
    speed: float = UNLIMITED


@dataclasses.dataclass(frozen=True, kw_only=True)
class Revolute:
    """How a thing turns.

    Attributes:
      elements: where its angle [rad] stands in the object positions of the observation.
      about: a point of the axis [m].
      axis: direction of the axis.
    """

    elements: tuple[int, ...]
    about: Vector
    axis: Vector

    def displacement(self, values: NDArray[np.float64]) -> mink.SE3:
        """How far the thing has moved from where it starts, by its angle `(1,)` [rad]."""
        centre, turn = np.array(self.about), mink.SO3.exp(values[0] * np.array(self.axis))
        return mink.SE3.from_rotation_and_translation(turn, centre - turn.apply(centre))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prismatic:
    """How a thing shifts: along x, or along x, y and z.

    Attributes:
      elements: where its one or three coordinates stand in the object positions of the observation.
      start: their values at the start [m].
    """

    elements: tuple[int, ...]
    start: tuple[float, ...]

    def displacement(self, values: NDArray[np.float64]) -> mink.SE3:
        """How far the thing has moved from where it starts, by its coordinates `(1,)` or `(3,)` [m]."""
        return mink.SE3.from_translation(np.pad(values - self.start, (0, 3 - values.size)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Skill:
    """What the hand does to one thing.

    Attributes:
      steps: the motions, one after the other; a `ArcMove` needs a hinge to go round.
      posture: joint positions near which those of the first step are sought, and from there those of the others [rad].
      thing: how the thing moves; places move along with it. None for a thing that is always found where it was.
      retreat: displacement of the site when it leaves, in the world [m].
      release: control steps to open the fingers before that; 0 where they hold nothing.
    """

    steps: tuple[Move | ArcMove, ...]
    posture: tuple[float, ...]
    thing: Revolute | Prismatic | None = None
    retreat: Vector = (0.0, 0.0, 0.0)
    release: int = 0

"""Places in kitchens on or in which an object can be put."""

import dataclasses
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.types import Vector

PlaceKind = Literal["burner", "tray", "worktop", "drawer", "cabinet", "microwave"]

PLACE_KINDS: tuple[PlaceKind, ...] = ("burner", "tray", "worktop", "drawer", "cabinet", "microwave")
"""Kinds of places, in the order in which observations have them."""

SURFACES = frozenset({"burner", "tray", "worktop"})
"""Kinds of places on which an object stands; it lies or stands in the others."""

ROOM = 0.2  # Height above a support up to which the centre of an object may be [m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Place:
    """A box in which the centre of an object is when the object is there.

    Its lower face is the support on which objects stand. It is in the frame of a fixture, or, in a kitchen,
    in the world; all sides are along the axes in both.

    Attributes:
      kind: one of `PLACE_KINDS`.
      name: within its fixture, such as `drawer_1`; in a kitchen with the name of the fixture before it.
      words: the place in words, such as `top drawer`; in a kitchen with those of its fixture.
      low: least x, y and z [m].
      high: greatest ones [m].
      parts: names of the joints of parts that have to be open.
      moves: whether the place moves with the first of the parts, as a drawer; low and high are where it is closed.
    """

    kind: PlaceKind
    name: str
    words: str
    low: Vector
    high: Vector
    parts: tuple[str, ...] = ()
    moves: bool = False

    @classmethod
    def on(
        cls, kind: PlaceKind, name: str, words: str, *, x: tuple[float, float], y: tuple[float, float], z: float
    ) -> Self:
        """Returns a place on a surface at a height, within bounds of x and y [m]."""
        return cls(kind=kind, name=name, words=words, low=(x[0], y[0], z), high=(x[1], y[1], z + ROOM))

    @classmethod
    def around(cls, kind: PlaceKind, name: str, words: str, centre: Vector, half: tuple[float, float]) -> Self:
        """Returns a place on a surface, of half a width and half a depth around a point of it [m]."""
        x, y, z = centre
        return cls.on(kind, name, words, x=(x - half[0], x + half[0]), y=(y - half[1], y + half[1]), z=z)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Middle of the support, `(3,)` [m]."""
        x, y, _ = np.add(self.low, self.high) / 2
        return np.array([x, y, self.low[2]])

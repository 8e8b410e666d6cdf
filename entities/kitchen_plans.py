"""Plans of kitchens: rows of fixtures around the robot, where each fixture stands, and whether all have room."""

import functools
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.fixture_designs import KINDS, AnyFixture, FixtureDesign, Level
from kitchen_suite.entities.kitchen_styles import StyleName

Side = Literal["back", "left", "right"]

SIDES: Mapping[Side, float] = MappingProxyType({"back": 0.0, "left": np.pi / 2, "right": -np.pi / 2})
"""Sides of the robot, each with the yaw of fixtures that stand there [rad]. The robot faces `back`."""

_OVERLAP = 0.004  # Depth up to which fixtures may overlap, such as by rounding [m].

# Half the width of the square around the robot's axis that no fixture but the oven may enter [m]: it has the pedestal,
# and room for the arm's base.
_ROBOT_ROOM = 0.16

_TOGETHER = ("oven", "hood")  # The hood is part of the oven's back, as in the original kitchen.


class Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Fixtures side by side, from left to right as seen from the robot.

    Attributes:
      side: of the robot.
      level: of its fixtures.
      distance: of the fronts from the axis of the robot's base [m].
      start: position of the left end along the row; 0 is before the robot [m].
      height: of the lower edges above the ground, for level `wall` only [m].
      fixtures: of the row.
    """

    side: Side
    level: Level
    distance: Annotated[float, Meta(ge=0.0, le=1.0)]
    start: Annotated[float, Meta(ge=-1.5, le=1.5)]
    height: Annotated[float, Meta(ge=1.4, le=2.7)] | None = None
    fixtures: tuple[AnyFixture, ...]

    def __post_init__(self) -> None:
        if (self.level == "wall") != (self.height is not None):
            raise ValueError("must have a height if, and only if, its level is 'wall'")
        kinds = [name for name, kind in KINDS.items() if kind.level == self.level]
        for fixture in self.fixtures:
            checks.choice(fixture.kind, kinds, f"kind of level {self.level!r}")


class Placed(NamedTuple):
    """A fixture in its place.

    Attributes:
      path: of the fixture in the design's JSON.
      name: of its entity in the scene.
      design: of the fixture.
      row: that it belongs to.
      position: `(3,)`, of the origin of its frame [m].
      yaw: of its frame [rad].
    """

    path: str
    name: str
    design: FixtureDesign
    row: Row
    position: NDArray[np.float64]
    yaw: float

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest corner of its extent in the world, `(3,)` each [m]."""
        corners = np.array([self.in_world(np.array(corner)) for corner in self.design.extent])
        return corners.min(axis=0), corners.max(axis=0)

    def in_world(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns a point `(3,)` of its frame in the world [m]."""
        return self.position + _rotated(self.yaw, *point)


def _rotated(yaw: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Returns a point `(3,)` after a rotation about the upright axis [m]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([cos * x - sin * y, sin * x + cos * y, z])


class KitchenPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, dict=True):
    """Plan of a kitchen.

    Attributes:
      counter_height: of the counters above the ground; the robot's base is at 1.8 [m].
      style: key of `STYLES`.
      kettle: whether a kettle stands on the oven.
      rows: of fixtures.
    """

    counter_height: Annotated[float, Meta(ge=1.5, le=1.9)]
    style: StyleName
    kettle: bool = False
    rows: tuple[Row, ...]

    @property
    def sequence(self) -> str:
        """The fixtures by row, without sizes, such as `back base: drawers stove; left tall: tall_door`."""
        rows = (f"{row.side} {row.level}: {' '.join(each.kind for each in row.fixtures)}" for row in self.rows)
        return "; ".join(rows) + ("; kettle" if self.kettle else "")

    @functools.cached_property
    def placed(self) -> tuple[Placed, ...]:
        """The fixtures in their places, row by row."""
        placed = []
        counts = dict.fromkeys(KINDS, 0)
        for i, row in enumerate(self.rows):
            along = row.start
            height = self.counter_height if row.height is None else row.height
            yaw = SIDES[row.side]
            for j, fixture in enumerate(row.fixtures):
                width = fixture.extent.width
                along += fixture.gap + width / 2
                position = _rotated(yaw, along, row.distance, height)
                counts[fixture.kind] += 1
                name = f"{fixture.kind}_{counts[fixture.kind]}"
                placed.append(Placed(f"rows[{i}].fixtures[{j}]", name, fixture, row, np.round(position, 6), yaw))
                along += width / 2
        return tuple(placed)

    def check(self) -> None:
        """Raises a ValueError, with a path in the JSON, unless there is a fixture and all have room."""
        if not self.placed:
            raise ValueError("rows must have at least one fixture")
        kinds = [each.design.kind for each in self.placed]
        if self.kettle and "oven" not in kinds:
            raise ValueError("kettle must be false in a kitchen without an oven, on which it stands")
        for kind in _TOGETHER:
            if kinds.count(kind) > 1:
                raise ValueError(f"rows must not have more than one fixture of kind {kind!r}")
        for i, placed in enumerate(self.placed):
            low, high = placed.bounds
            if (low[:2] < _ROBOT_ROOM).all() and (high[:2] > -_ROBOT_ROOM).all() and placed.design.kind != "oven":
                raise ValueError(f"{placed.path} stands where the robot does: increase the distance of its row")
            for other in self.placed[:i]:
                _check_apart(other, placed)


def _check_apart(one: Placed, other: Placed) -> None:
    """Raises a ValueError if two fixtures overlap."""
    if {one.design.kind, other.design.kind} == {*_TOGETHER}:
        return
    low, high = one.bounds
    other_low, other_high = other.bounds
    depths = np.minimum(high, other_high) - np.maximum(low, other_low)
    if (depths > _OVERLAP).all():
        raise ValueError(
            f"{other.path} ({other.design.kind}) overlaps {one.path} ({one.design.kind}) by {depths.min():.3f} m"
        )


_ORDINALS = (
    *("first ", "second ", "third ", "fourth ", "fifth ", "sixth ", "seventh ", "eighth "),
    *("ninth ", "tenth ", "eleventh ", "twelfth ", "thirteenth ", "fourteenth ", "fifteenth ", "sixteenth "),
)


def fixture_words(one: Placed, placed: Sequence[Placed]) -> str:
    """Returns a fixture in words, with its place among those called the same unless it is the only one."""
    words = one.design.words
    same = [each for each in placed if each.design.words == words]
    same.sort(key=lambda each: np.arctan2(each.position[0], each.position[1]))
    places = {1: ("",), 2: ("left ", "right "), 3: ("left ", "middle ", "right ")}.get(len(same), _ORDINALS)
    azimuths = [np.arctan2(each.position[0], each.position[1]) for each in same]
    if (np.diff(azimuths) < 0.01).any():  # One is above another.
        same.sort(key=lambda each: each.position[2])
        places = ("lower ", "upper ") if len(same) == 2 else _ORDINALS
    return f"{places[same.index(one)]}{words}"

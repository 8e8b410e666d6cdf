"""Designs of fixtures: a record for each kind, with the bounds of its sizes and the box that the fixture takes up.

A fixture's frame has its origin in the middle of its front, x to the right of who stands before it, y into it, z up.
The origin is at the upper edge of a fixture below a counter, and of a tall one at the counter's height; that of others
is at the lower edge.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, NamedTuple, get_args

import msgspec
import numpy as np
from msgspec import Meta

from kitchen_suite.types import Vector

Level = Literal["base", "counter", "wall", "tall"]  # Below the counter, on it, above it, or beside it.
Handle = Literal["bar", "knob"]
Hinge = Literal["left", "right"]

LEVELS: tuple[Level, ...] = get_args(Level)
HANDLES: tuple[Handle, ...] = get_args(Handle)
HINGES: tuple[Hinge, ...] = get_args(Hinge)

CLEARANCE = 0.06  # Distance of the axis of a handle's bar from the front [m].
KNOB_RADIUS = 0.018  # Radius of a knob as a handle [m].

_ROOM = CLEARANCE + KNOB_RADIUS  # Room before fixtures of boxes that handles take up [m].

_BASE_DEPTH = 0.5  # Depth of fixtures of boxes below a counter, and of tall ones [m].
_WALL_DEPTH = 0.32  # Depth of fixtures of boxes above a counter [m].

_TALL_BOTTOM = -0.75  # Lower edge of a tall cabinet, from the counter's height up [m].
_TALL_TOP = 0.85  # Upper edge of a tall cabinet, from the counter's height up [m].

_OVEN_COUNTER = 1.6  # Height of the kitchen's counter above the frame of its oven [m].

STOVE_WIDTH = 0.45  # Least width of a stove [m].
SLIDING_WIDTH = 0.5  # Least width of a cabinet with a sliding door [m].

_Width = Annotated[float, Meta(ge=0.3, le=0.9)]
_Count = Annotated[int, Meta(ge=1, le=4)]
_DoorCount = Annotated[int, Meta(ge=1, le=2)]


class Extent(NamedTuple):
    """A box in a fixture's frame: what the fixture takes up when it is closed, with its handles [m].

    The handle of a sliding door reaches up to 24 mm farther. Certificates measure the parts themselves.

    Attributes:
      low: least x, y and z.
      high: greatest ones.
    """

    low: Vector
    high: Vector

    @property
    def width(self) -> float:
        """Along x [m]."""
        return self.high[0] - self.low[0]

    @property
    def depth(self) -> float:
        """Greatest y, from the front to the back [m]."""
        return self.high[1]

    @property
    def bottom(self) -> float:
        """Least z [m]."""
        return self.low[2]

    @property
    def top(self) -> float:
        """Greatest z [m]."""
        return self.high[2]


class FixtureDesign(
    msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True, omit_defaults=True
):
    """Design of a fixture. The tag of its class is its kind in JSON, where bounds are checked when it is read.

    Attributes:
      level: of the rows in which it stands.
      words: the fixture in words.
      gap: free space to its left in the row [m].
    """

    level: ClassVar[Level]
    words: ClassVar[str]

    gap: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0

    @property
    def kind(self) -> str:
        """Key of `KINDS`."""
        return str(self.__struct_config__.tag)

    @property
    def extent(self) -> Extent:
        """Box that the fixture takes up, in its frame."""
        raise NotImplementedError

    @property
    def origin(self) -> Vector:
        """Position of the frame of its entity in the fixture's frame [m]."""
        return 0.0, 0.0, 0.0


class DrawersDesign(FixtureDesign, frozen=True, tag="drawers"):
    """Drawers below a worktop, one above the other.

    Attributes:
      width: along the row [m].
      height: from its lower edge to the upper face of the worktop [m].
      count: number of drawers.
      handle: of each drawer.
    """

    level = "base"
    words = "cabinet"

    width: _Width
    height: Annotated[float, Meta(ge=0.16, le=0.6)]
    count: _Count
    handle: Handle

    @property
    def extent(self) -> Extent:
        return _boxes_extent(self.width, bottom=-self.height, top=0.0, depth=_BASE_DEPTH)


class BaseDoorsDesign(FixtureDesign, frozen=True, tag="base_doors"):
    """One or two hinged doors below a worktop.

    Attributes:
      width: along the row [m].
      height: from its lower edge to the upper face of the worktop [m].
      count: number of doors.
      handle: of each door.
      hinge: side of the hinges of a single door; None for two, which are hinged at both sides.
    """

    level = "base"
    words = "cabinet"

    width: _Width
    height: Annotated[float, Meta(ge=0.3, le=0.7)]
    count: _DoorCount
    handle: Handle
    hinge: Hinge | None = None

    def __post_init__(self) -> None:
        _check_hinge(self.count, self.hinge)

    @property
    def hinges(self) -> tuple[Hinge, ...]:
        """Sides on which doors are hinged."""
        return HINGES if self.hinge is None else (self.hinge,)

    @property
    def extent(self) -> Extent:
        return _boxes_extent(self.width, bottom=-self.height, top=0.0, depth=_BASE_DEPTH)


class StoveDesign(FixtureDesign, frozen=True, tag="stove"):
    """A stove below a cooktop, with knobs in its front.

    Attributes:
      width: along the row [m].
      height: from its lower edge to the cooktop [m].
      count: number of knobs.
    """

    level = "base"
    words = "stove"

    width: Annotated[float, Meta(ge=STOVE_WIDTH, le=0.9)]
    height: Annotated[float, Meta(ge=0.4, le=0.7)]
    count: _Count

    @property
    def extent(self) -> Extent:
        return _boxes_extent(self.width, bottom=-self.height, top=0.0, depth=_BASE_DEPTH)


class WallDoorsDesign(FixtureDesign, frozen=True, tag="wall_doors"):
    """A cabinet above the counter with one or two hinged doors.

    Attributes:
      width: along the row [m].
      height: of the cabinet [m].
      count: number of doors.
      handle: of each door.
      hinge: side of the hinges of a single door; None for two, which are hinged at both sides.
    """

    level = "wall"
    words = "wall cabinet"

    width: _Width
    height: Annotated[float, Meta(ge=0.3, le=0.6)]
    count: _DoorCount
    handle: Handle
    hinge: Hinge | None = None

    def __post_init__(self) -> None:
        _check_hinge(self.count, self.hinge)

    @property
    def hinges(self) -> tuple[Hinge, ...]:
        """Sides on which doors are hinged."""
        return HINGES if self.hinge is None else (self.hinge,)

    @property
    def extent(self) -> Extent:
        return _boxes_extent(self.width, bottom=0.0, top=self.height, depth=_WALL_DEPTH)


class WallSlidingDesign(FixtureDesign, frozen=True, tag="wall_sliding"):
    """A cabinet above the counter with a sliding door before one half.

    Attributes:
      width: along the row [m].
      height: of the cabinet [m].
      handle: of the door.
      hinge: side from which the door slides away.
    """

    level = "wall"
    words = "wall cabinet"

    width: Annotated[float, Meta(ge=SLIDING_WIDTH, le=0.9)]
    height: Annotated[float, Meta(ge=0.3, le=0.6)]
    handle: Handle
    hinge: Hinge

    @property
    def extent(self) -> Extent:
        return _boxes_extent(self.width, bottom=0.0, top=self.height, depth=_WALL_DEPTH)


class TallDoorDesign(FixtureDesign, frozen=True, tag="tall_door"):
    """A tall cabinet with a hinged door.

    Attributes:
      width: along the row [m].
      handle: of the door.
      hinge: side of its hinges.
    """

    level = "tall"
    words = "tall cabinet"

    width: Annotated[float, Meta(ge=0.3, le=0.6)]
    handle: Handle
    hinge: Hinge

    @property
    def hinges(self) -> tuple[Hinge, ...]:
        """Sides on which doors are hinged."""
        return (self.hinge,)

    @property
    def extent(self) -> Extent:
        return _boxes_extent(self.width, bottom=_TALL_BOTTOM, top=_TALL_TOP, depth=_BASE_DEPTH)


class KitchenPropDesign(FixtureDesign, frozen=True):
    """A prop of the kitchen as a fixture, which has one size.

    Attributes:
      low: least corner of what it takes up without handles, in the prop's own frame [m].
      high: greatest corner of it [m].
      room: for handles before it [m].
    """

    low: ClassVar[Vector]
    high: ClassVar[Vector]
    room: ClassVar[float] = 0.0

    @property
    def origin(self) -> Vector:
        height = _OVEN_COUNTER if self.level == "base" else self.low[2]
        return -(self.low[0] + self.high[0]) / 2, -self.low[1], -height

    @property
    def extent(self) -> Extent:
        x, y, z = np.add(self.low, self.origin).tolist()
        right, back, top = np.add(self.high, self.origin).tolist()
        return Extent((x, y - self.room, z), (right, back, top))


class OvenDesign(KitchenPropDesign, frozen=True, tag="oven"):
    """The kitchen's oven, with its knobs and burners."""

    level = "base"
    words = "oven"
    low = (-0.402, -0.704, 0.0)
    high = (0.598, 0.613, 2.39)


class HoodDesign(KitchenPropDesign, frozen=True, tag="hood"):
    """The hood above the kitchen's oven, with the light switch."""

    level = "wall"
    words = "hood"
    low = (-0.402, -0.179, 2.164)
    high = (0.602, 0.597, 2.404)


class HingeCabinetDesign(KitchenPropDesign, frozen=True, tag="hinge_cabinet"):
    """The kitchen's cabinet with hinged doors."""

    level = "wall"
    words = "hinge cabinet"
    low = (-0.4, -0.35, -0.2)
    high = (0.4, 0.3, 0.2)
    room = 0.12


class SlideCabinetDesign(KitchenPropDesign, frozen=True, tag="slide_cabinet"):
    """The kitchen's cabinet with a sliding door."""

    level = "wall"
    words = "slide cabinet"
    low = (-0.45, -0.36, -0.2)
    high = (0.45, 0.3, 0.2)
    room = 0.11


class MicrowaveDesign(KitchenPropDesign, frozen=True, tag="microwave"):
    """The kitchen's microwave."""

    level = "counter"
    words = "microwave"
    low = (-0.345, -0.221, 0.0)
    high = (0.345, 0.222, 0.374)
    room = 0.1


AnyFixture = (
    DrawersDesign
    | BaseDoorsDesign
    | StoveDesign
    | WallDoorsDesign
    | WallSlidingDesign
    | TallDoorDesign
    | OvenDesign
    | HoodDesign
    | HingeCabinetDesign
    | SlideCabinetDesign
    | MicrowaveDesign
)
"""A design of any kind, told apart in JSON by `kind`."""

KINDS: Mapping[str, type[AnyFixture]] = MappingProxyType(
    {kind.__struct_config__.tag: kind for kind in get_args(AnyFixture)}
)
"""The kinds of fixtures by name."""


def _boxes_extent(width: float, *, bottom: float, top: float, depth: float) -> Extent:
    """Returns what a fixture of boxes takes up, with its handles [m]."""
    return Extent((-width / 2, -_ROOM, bottom), (width / 2, depth, top))


def _check_hinge(count: int, hinge: Hinge | None) -> None:
    """Raises a ValueError unless a single door has a hinge, and two doors have none."""
    if (count == 1) != (hinge is not None):
        raise ValueError("must have a hinge if, and only if, its count is 1")

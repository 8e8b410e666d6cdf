"""Kinds of fixtures: a class for each, with the bounds of its sizes, its extent, and how it is built.

A fixture's frame has its origin in the middle of its front, x to the right of who stands before it, y into it, z up.
The origin is at the upper edge of a fixture below a counter, and of a tall one at the counter's height; that of others
is at the lower edge.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, NamedTuple, get_args

import msgspec
import numpy as np
from msgspec import Meta

from kitchen_suite.entities import props
from kitchen_suite.entities.fixtures import (
    CLEARANCE,
    GAP,
    KNOB_RADIUS,
    PANEL,
    WORKTOP,
    BoxFixture,
    BuiltFixture,
    Handle,
    Part,
)
from kitchen_suite.entities.kitchen_styles import Style
from kitchen_suite.entities.places import ROOM, Place
from kitchen_suite.entities.props import Prop
from kitchen_suite.types import Vector

Level = Literal["base", "counter", "wall", "tall"]  # Below the counter, on it, above it, or beside it.
Hinge = Literal["left", "right"]

LEVELS: tuple[Level, ...] = get_args(Level)
HANDLES: tuple[Handle, ...] = get_args(Handle)
HINGES: tuple[Hinge, ...] = get_args(Hinge)

_ROOM = CLEARANCE + KNOB_RADIUS  # Room before fixtures of boxes that handles take up [m].

_BASE_DEPTH = 0.5  # Depth of fixtures of boxes below a counter, and of tall ones [m].
_WALL_DEPTH = 0.32  # Depth of fixtures of boxes above a counter [m].

_TALL_BOTTOM = -0.75  # Lower edge of a tall cabinet, from the counter's height up [m].
_TALL_TOP = 0.85  # Upper edge of a tall cabinet, from the counter's height up [m].

_OVEN_COUNTER = 1.6  # Height of the kitchen's counter above the frame of its oven [m].
_OVEN_TOP = 0.0184  # Height of the oven's top above the counter [m].

_BURNER_RADIUS = 0.1  # Distance from the middle of a burner up to which the centre of an object is on it [m].

STOVE_WIDTH = 0.45  # Least width of a stove [m].
SLIDING_WIDTH = 0.5  # Least width of a cabinet with a sliding door [m].

_EDGE = 0.05  # Distance of a door's handle from the door's free edge [m].
_CORNER = 0.1  # Distance of a door's handle from the door's upper or lower edge [m].

_DRAWER_TRAVEL = 0.3  # Greatest travel of drawers [m].
_SLIDING_TRAVEL = 0.26  # Greatest travel of sliding doors [m].
_DOOR_TRAVEL = 1.57  # Greatest travel of hinged doors [rad].

_DRAWER_OPENING = 0.2  # Opening at which a drawer counts as wide open [m].
_SLIDING_OPENING = 0.2  # Opening at which a sliding door counts as wide open [m].
_DOOR_OPENING = 0.9  # Opening at which a hinged door counts as wide open [rad].
_KNOB_ANGLE = -0.88  # Angle at which a knob counts as on [rad].
_SWITCH_ANGLE = -0.69  # Angle at which a switch counts as on [rad].

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

    @property
    def places(self) -> tuple[Place, ...]:
        """Places for objects, in the fixture's frame: those that an arm may reach."""
        return ()

    def build(self, style: Style, *, visuals: bool, name: str) -> BuiltFixture:
        """Builds the fixture.

        Args:
          style: colours of the boxes, or of the lacquer of a prop of the kitchen.
          visuals: `False` leaves out the visual geoms; the physics stays the same to the bit.
          name: prefix of its elements in a scene.
        """
        raise NotImplementedError


class BoxDesign(FixtureDesign, frozen=True):
    """A fixture of boxes."""

    def build(self, style: Style, *, visuals: bool, name: str) -> BuiltFixture:
        prop = BoxFixture(furnish=self.furnish, style=style, visuals=visuals, name=name)
        return BuiltFixture(prop, prop.parts)

    def furnish(self, fixture: BoxFixture) -> None:
        """Adds the boxes and the parts to a fixture, within the extent."""
        raise NotImplementedError


class DrawersDesign(BoxDesign, frozen=True, tag="drawers"):
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
        return _base_extent(self.width, self.height)

    @property
    def _drawer_height(self) -> float:
        """Height of a drawer with its front and the gap around it [m]."""
        return (self.height - WORKTOP) / self.count

    @property
    def places(self) -> tuple[Place, ...]:
        half = self.width / 2 - PANEL - GAP - 0.01
        drawers = []
        for number in range(self.count):
            name = f"drawer_{number + 1}"
            # Closed, it ends below what is above it.
            top = -WORKTOP - number * self._drawer_height
            floor = top - self._drawer_height + PANEL + GAP + 0.01
            drawers.append(
                Place(
                    kind="drawer",
                    name=name,
                    words=_numbered("drawer", number, self.count),
                    low=(-half, PANEL, floor),
                    high=(half, _DRAWER_TRAVEL, min(floor + ROOM, top)),
                    parts=(name,),
                    moves=True,
                )
            )
        return (_worktop(self), *drawers)

    def furnish(self, fixture: BoxFixture) -> None:
        extent = self.extent
        half_width = self.width / 2
        fixture.add_worktop(self.width, extent.depth, extent.top)
        fixture.add_carcass((-half_width, 0, extent.bottom), (half_width, extent.depth, -WORKTOP))
        height = self._drawer_height
        inner = half_width - PANEL - GAP
        back = extent.depth - 2 * PANEL
        joint = {"type": "slide", "axis": (0, -1, 0), "range": (0, _DRAWER_TRAVEL), "damping": 8, "frictionloss": 2}
        for number in range(self.count):
            name = f"drawer_{number + 1}"
            words = _numbered("drawer", number, self.count)
            body = fixture.add_part("drawer", name, _DRAWER_OPENING, words, joint=joint)
            top = -WORKTOP - number * height
            low = (-half_width + GAP, 0, top - height + GAP / 2)
            high = (half_width - GAP, PANEL, top - GAP / 2)
            fixture.add_box(body, name, low, high, "front", 0.8)
            floor = top - height + PANEL + GAP
            rim = max(top - 0.3 * height, floor + 0.01)
            fixture.add_box(body, f"{name}_floor", (-inner, PANEL, floor), (inner, back, floor + 0.01), "carcass", 0.4)
            for side, x in (("left", -inner), ("right", inner - 0.01)):
                fixture.add_box(body, f"{name}_{side}", (x, PANEL, floor), (x + 0.01, back, rim), "carcass", 0.1)
            fixture.add_handle(body, self.handle, (0, 0, top - height / 2), upright=False)


class DoorsDesign(BoxDesign, frozen=True):
    """One or two hinged doors below a worktop or above a counter.

    Attributes:
      handle_height: of the handles, in the fixture's frame [m].
      width: along the row [m].
      height: from the fixture's lower edge to its upper one, which may be that of a worktop [m].
      count: number of doors.
      handle: of each door.
      hinge: side of the hinges of a single door; None for two, which are hinged at both sides.
    """

    handle_height: ClassVar[float]

    width: _Width
    height: float
    count: _DoorCount
    handle: Handle
    hinge: Hinge | None = None

    def __post_init__(self) -> None:
        if (self.count == 1) != (self.hinge is not None):
            raise ValueError("must have a hinge if, and only if, its count is 1")

    @property
    def hinges(self) -> tuple[Hinge, ...]:
        """Sides on which doors are hinged."""
        return HINGES if self.hinge is None else (self.hinge,)


class BaseDoorsDesign(DoorsDesign, frozen=True, tag="base_doors"):
    """One or two hinged doors below a worktop; see `DoorsDesign`."""

    level = "base"
    words = "cabinet"
    handle_height = -WORKTOP - _CORNER

    height: Annotated[float, Meta(ge=0.3, le=0.7)]

    @property
    def extent(self) -> Extent:
        return _base_extent(self.width, self.height)

    def furnish(self, fixture: BoxFixture) -> None:
        extent = self.extent
        fixture.add_worktop(self.width, extent.depth, extent.top)
        _add_doors(fixture, self, top=extent.top - WORKTOP)

    @property
    def places(self) -> tuple[Place, ...]:
        return (_worktop(self), _inside(self))


class StoveDesign(BoxDesign, frozen=True, tag="stove"):
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
        return _base_extent(self.width, self.height)

    def furnish(self, fixture: BoxFixture) -> None:
        extent = self.extent
        width = self.width
        depth = extent.depth
        bottom = extent.bottom
        body = fixture.body
        fixture.add_box(body, "top", (-width / 2, -0.01, -WORKTOP), (width / 2, depth, 0), "dark")
        fixture.add_box(body, "case", (-width / 2 + GAP, 0, bottom), (width / 2 - GAP, depth, -WORKTOP), "steel")
        window = (-0.35 * width, -0.004, 0.9 * bottom), (0.35 * width, 0, 0.4 * bottom)
        fixture.add_box(body, "window", *window, "dark")
        step = min(0.15, (width - 0.1) / self.count)
        for number in range(self.count):
            words = _numbered("knob", number, self.count, ("left", "middle", "right"))
            _add_knob(fixture, f"knob_{number + 1}", words, (number - (self.count - 1) / 2) * step)
        for x, y in self._burners:
            for radius, height, material in ((0.09, 0.002, "steel"), (0.08, 0.003, "dark")):
                plate = {"type": "cylinder", "size": (radius, height), "pos": (x, y, 0)}
                body.add("geom", dclass="visual", material=material, **plate)

    @property
    def _burners(self) -> Sequence[tuple[float, float]]:
        """Middles of the burners on the cooktop: left to right, and at each side front to back [m]."""
        depth = self.extent.depth
        return [(x, y) for x in (-0.22 * self.width, 0.22 * self.width) for y in (0.27 * depth, 0.73 * depth)]

    @property
    def places(self) -> tuple[Place, ...]:
        return (_worktop(self), *_burners([(x, y, 0.0) for x, y in self._burners]))


class WallDoorsDesign(DoorsDesign, frozen=True, tag="wall_doors"):
    """A cabinet above the counter with one or two hinged doors; see `DoorsDesign`."""

    level = "wall"
    words = "wall cabinet"
    handle_height = _CORNER

    height: Annotated[float, Meta(ge=0.3, le=0.6)]

    @property
    def extent(self) -> Extent:
        return _wall_extent(self.width, self.height)

    def furnish(self, fixture: BoxFixture) -> None:
        _add_doors(fixture, self, top=self.extent.top)

    @property
    def places(self) -> tuple[Place, ...]:
        return (_inside(self),)


class WallSlidingDesign(BoxDesign, frozen=True, tag="wall_sliding"):
    """A cabinet above the counter with a door before one half, which slides before the other half.

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
        return _wall_extent(self.width, self.height)

    def furnish(self, fixture: BoxFixture) -> None:
        extent = self.extent
        half_width = self.width / 2
        fixture.add_carcass((-half_width, 0, 0), (half_width, extent.depth, extent.top))
        upper = extent.top - GAP
        sign = 1 if self.hinge == "left" else -1
        left, right = sorted((0.0, sign * (half_width - GAP)))
        fixture.add_box(fixture.body, "panel", (left, 0, GAP), (right, PANEL, upper), "front")
        travel = self._travel
        slide = {"axis": (1, 0, 0), "range": (0, travel) if sign > 0 else (-travel, 0)}
        joint = {"type": "slide", **slide, "damping": 2, "frictionloss": 2}
        opened = sign * min(_SLIDING_OPENING, 0.8 * travel)
        body = fixture.add_part("sliding door", "door", opened, "sliding door", joint=joint)
        left, right = sorted((-sign * (half_width - GAP), 0.0))
        fixture.add_box(body, "door", (left, -PANEL - GAP, GAP), (right, -GAP, upper), "front", 1.0)
        place = (-sign * (half_width - _EDGE - GAP), -PANEL - GAP, _CORNER)
        fixture.add_handle(body, self.handle, place, upright=True)

    @property
    def _travel(self) -> float:
        """How far the door slides [m]."""
        return min(_SLIDING_TRAVEL, self.width / 2 - _EDGE)

    @property
    def places(self) -> tuple[Place, ...]:
        extent = self.extent
        # As far as the door slides away.
        side = self.width / 2 - PANEL
        edge = self.width / 2 - self._travel
        x = (-side, -edge) if self.hinge == "left" else (edge, side)
        place = Place.on("cabinet", "inside", "", x=x, y=(PANEL, extent.depth - PANEL), z=PANEL)
        return (dataclasses.replace(place, parts=("door",)),)


class TallDoorDesign(BoxDesign, frozen=True, tag="tall_door"):
    """A tall cabinet with a hinged door.

    Attributes:
      handle_height: of the handle, in the fixture's frame [m].
      width: along the row [m].
      handle: of the door.
      hinge: side of its hinges.
    """

    level = "tall"
    words = "tall cabinet"
    handle_height: ClassVar[float] = 0.2

    width: Annotated[float, Meta(ge=0.3, le=0.6)]
    handle: Handle
    hinge: Hinge

    @property
    def hinges(self) -> tuple[Hinge, ...]:
        """Sides on which doors are hinged."""
        return (self.hinge,)

    @property
    def extent(self) -> Extent:
        return _box_extent(self.width, bottom=_TALL_BOTTOM, top=_TALL_TOP, depth=_BASE_DEPTH)

    def furnish(self, fixture: BoxFixture) -> None:
        _add_doors(fixture, self, top=self.extent.top)


class KitchenPropDesign(FixtureDesign, frozen=True):
    """A prop of the kitchen as a fixture, which has one size.

    Attributes:
      prop: class of the prop.
      parts: that move, which have names of their own.
      low: least corner of what it takes up without handles, in the prop's own frame [m].
      high: greatest corner of it [m].
      room: for handles before it [m].
    """

    prop: ClassVar[type[Prop]]
    parts: ClassVar[tuple[Part, ...]]
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

    def build(self, style: Style, *, visuals: bool, name: str) -> BuiltFixture:
        prop = self.prop(visuals=visuals, name=name)
        lacquer = prop.mjcf_model.find("material", "lacquer")
        if lacquer is not None:
            lacquer.rgba = (*style.front, 1)
        return BuiltFixture(prop, self.parts)


def _oven_knob(number: int, place: str, burner: str, twin: str) -> Part:
    """Returns a knob of the oven, which moves its burner."""
    return Part(
        "knob",
        f"knob_Joint_{number}",
        f"knob_{number}",
        _KNOB_ANGLE,
        f"{place} knob",
        follower=burner,
        ratio=1 / 174,
        twin=twin,
    )


class OvenDesign(KitchenPropDesign, frozen=True, tag="oven"):
    """The kitchen's oven, with its knobs and burners."""

    level = "base"
    words = "oven"
    prop = props.Oven
    parts = (
        _oven_knob(4, "upper left", "top_left_burner", "top burner"),
        _oven_knob(3, "upper right", "top_right_burner", "top right burner"),
        _oven_knob(2, "lower left", "bottom_left_burner", "bottom burner"),
        _oven_knob(1, "lower right", "bottom_right_burner", "bottom right burner"),
    )
    low = (-0.402, -0.704, 0.0)
    high = (0.598, 0.613, 2.39)

    @property
    def places(self) -> tuple[Place, ...]:
        # Middles of the burners in `xml/oven.xml`, in the order of those of stoves.
        burners = [(-0.223, 0.293), (-0.22, 0.734), (0.223, 0.293), (0.221, 0.734)]
        top = Place.on("worktop", "worktop", "top", x=(-0.49, 0.49), y=(0.08, 0.6), z=_OVEN_TOP)
        return (top, *_burners([(x, y, _OVEN_TOP) for x, y in burners]))


class HoodDesign(KitchenPropDesign, frozen=True, tag="hood"):
    """The hood above the kitchen's oven, with the light switch."""

    level = "wall"
    words = "hood"
    prop = props.Hood
    parts = (
        Part(
            "switch",
            "light_switch",
            "switch",
            _SWITCH_ANGLE,
            "light switch",
            follower="light_joint",
            ratio=1 / 14,
            twin="light switch",
        ),
    )
    low = (-0.402, -0.179, 2.164)
    high = (0.602, 0.597, 2.404)


class HingeCabinetDesign(KitchenPropDesign, frozen=True, tag="hinge_cabinet"):
    """The kitchen's cabinet with hinged doors."""

    level = "wall"
    words = "hinge cabinet"
    prop = props.HingeCabinet
    # The left door is in reach in few places only.
    parts = (Part("door", "right_hinge_cabinet", "right_handle", 1.3, "right door", twin="hinge cabinet"),)
    low = (-0.4, -0.35, -0.2)
    high = (0.4, 0.3, 0.2)
    room = 0.12

    @property
    def places(self) -> tuple[Place, ...]:
        place = Place.on("cabinet", "inside", "", x=(0.04, 0.36), y=(0.05, 0.61), z=0.04)
        return (dataclasses.replace(place, parts=("right_hinge_cabinet",)),)


class SlideCabinetDesign(KitchenPropDesign, frozen=True, tag="slide_cabinet"):
    """The kitchen's cabinet with a sliding door."""

    level = "wall"
    words = "slide cabinet"
    prop = props.SlideCabinet
    parts = (Part("sliding door", "slide_cabinet", "handle", 0.33, "sliding door", twin="slide cabinet"),)
    low = (-0.45, -0.36, -0.2)
    high = (0.45, 0.3, 0.2)
    room = 0.11

    @property
    def places(self) -> tuple[Place, ...]:
        place = Place.on("cabinet", "inside", "", x=(-0.4, 0.0), y=(0.06, 0.61), z=0.04)
        return (dataclasses.replace(place, parts=("slide_cabinet",)),)


class MicrowaveDesign(KitchenPropDesign, frozen=True, tag="microwave"):
    """The kitchen's microwave."""

    level = "counter"
    words = "microwave"
    prop = props.Microwave
    parts = (Part("door", "microwave", "handle", -0.75, "door", twin="microwave"),)
    low = (-0.345, -0.221, 0.0)
    high = (0.345, 0.222, 0.374)
    room = 0.1

    @property
    def places(self) -> tuple[Place, ...]:
        place = Place.on("microwave", "inside", "", x=(-0.287, 0.127), y=(0.046, 0.382), z=0.048)
        return (dataclasses.replace(place, parts=("microwave",)),)


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


def _base_extent(width: float, height: float) -> Extent:
    """Returns what a fixture of boxes below a counter takes up, with its handles [m]."""
    return _box_extent(width, bottom=-height, top=0.0, depth=_BASE_DEPTH)


def _wall_extent(width: float, height: float) -> Extent:
    """Returns what a fixture of boxes above a counter takes up, with its handles [m]."""
    return _box_extent(width, bottom=0.0, top=height, depth=_WALL_DEPTH)


def _box_extent(width: float, *, bottom: float, top: float, depth: float) -> Extent:
    """Returns what a fixture of boxes takes up, with its handles [m]."""
    return Extent((-width / 2, -_ROOM, bottom), (width / 2, depth, top))


def _worktop(design: FixtureDesign) -> Place:
    """Returns the top of a fixture of boxes below a counter as a place."""
    half_width = design.extent.width / 2
    return Place.on("worktop", "worktop", "top", x=(-half_width, half_width), y=(0.0, design.extent.depth), z=0.0)


def _burners(middles: Sequence[Vector]) -> tuple[Place, ...]:
    """Returns four burners as places: left to right, and at each side front to back."""
    words = ("front left burner", "back left burner", "front right burner", "back right burner")
    half = (_BURNER_RADIUS, _BURNER_RADIUS)
    return tuple(
        Place.around("burner", f"burner_{number + 1}", words[number], middle, half)
        for number, middle in enumerate(middles)
    )


def _inside(design: DoorsDesign) -> Place:
    """Returns the inside of a cabinet with hinged doors as a place."""
    extent = design.extent
    side = design.width / 2 - PANEL
    back = extent.depth - PANEL
    place = Place.on("cabinet", "inside", "", x=(-side, side), y=(PANEL, back), z=extent.bottom + PANEL)
    return dataclasses.replace(place, parts=tuple(f"{hinge}_door" for hinge in design.hinges))


def _add_doors(fixture: BoxFixture, design: DoorsDesign | TallDoorDesign, *, top: float) -> None:
    """Adds a carcass up to a height in the fixture's frame [m], and its hinged doors."""
    extent = design.extent
    half_width = design.width / 2
    fixture.add_carcass((-half_width, 0, extent.bottom), (half_width, extent.depth, top))
    is_single = len(design.hinges) == 1
    span = design.width / len(design.hinges) - 2 * GAP
    lower = extent.bottom + GAP
    upper = top - GAP
    mass = max(0.5, 6.0 * span * (upper - lower))
    for side in design.hinges:
        words = "door" if is_single else f"{side} door"
        # Of the side of the hinges, from which the door swings towards who stands before it.
        sign = 1 if side == "left" else -1
        swing = {"axis": (0, 0, 1), "range": (-_DOOR_TRAVEL, 0) if sign > 0 else (0, _DOOR_TRAVEL)}
        joint = {"type": "hinge", **swing, "damping": 0.8, "frictionloss": 0.6}
        pos = (-sign * (half_width - GAP), PANEL / 2, 0)
        body = fixture.add_part("door", f"{side}_door", -sign * _DOOR_OPENING, words, joint=joint, pos=pos)
        left, right = sorted((0.0, sign * span))
        fixture.add_box(body, body.name, (left, -PANEL / 2, lower), (right, PANEL / 2, upper), "front", mass)
        place = (sign * (span - _EDGE), -PANEL / 2, design.handle_height)
        fixture.add_handle(body, design.handle, place, upright=True)


def _add_knob(fixture: BoxFixture, name: str, words: str, x: float) -> None:
    """Adds a knob like those of the oven, whose bar is upright while it is off."""
    joint = {"type": "hinge", "axis": (0, 0, 1), "range": (-1.57, 0), "damping": 0.4, "frictionloss": 0.1}
    place = {"pos": (x, 0, -WORKTOP - 0.07), "xyaxes": (1, 0, 0, 0, 0, 1)}
    body = fixture.add_part("knob", name, _KNOB_ANGLE, words, joint=joint, **place)
    mass = {"mass": 0.01}
    bar = (0, 0, 0.038)
    fixture.add_geoms(body, f"{name}_bar", "dark", mass, type="box", pos=bar, size=(0.014, 0.048, 0.018))
    fixture.add_geoms(body, f"{name}_disc", "steel", mass, type="cylinder", pos=(0, 0, 0.013), size=(0.05, 0.008))
    body.add("site", name=f"{name}_handle", pos=bar, size=(0.01,), group=3)


def _numbered(noun: str, number: int, count: int, ends: Sequence[str] = ("top", "middle", "bottom")) -> str:
    """Returns a part in words: alone, the first, the last, or one between them by its number."""
    if count == 1:
        return noun
    first, middle, last = ends
    between = (middle,) if count == 3 else ("second", "third")[: count - 2]
    return f"{(first, *between, last)[number]} {noun}"

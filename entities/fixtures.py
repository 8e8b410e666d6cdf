"""Fixtures of generated kitchens: parametric cabinets and stoves from boxes, and the kitchen's own props.

A fixture's frame has its origin in the middle of its front, x to the right of who stands before it, y into it, z up.
The origin is at the upper edge of a fixture below a counter, and of a tall one at the counter's height; that of others
is at the lower edge. Each fixture has an extent, and parts that move: drawers, doors, knobs, a switch.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import assets, props
from kitchen_suite.entities.assets import Vector
from kitchen_suite.entities.props import Prop

PART_KINDS = ("drawer", "door", "sliding door", "knob", "switch", "kettle")  # Kinds of parts.
HANDLES = ("bar", "knob")  # Handles of parametric fixtures.
GAP = 0.004  # Gap between fronts, and from a front to the edge of its fixture [m].

PANEL = 0.02  # Thickness of panels [m].
WORKTOP = 0.03  # Thickness of worktops [m].

CLEARANCE = 0.06  # Distance of the axis of a handle's bar from the front [m].
BAR_RADIUS = 0.01  # Radius of a handle's bar [m].
BAR_HALF_LENGTH = 0.06  # Half length of a handle's bar [m].
KNOB_RADIUS = 0.018  # Radius of a knob as a handle [m].

EDGE = 0.05  # Distance of a door's handle from the door's free edge [m].
CORNER = 0.1  # Distance of a door's handle from the door's upper or lower edge [m].

_DRAWER_TRAVEL = 0.3  # Greatest travel of drawers [m].
_SLIDING_TRAVEL = 0.26  # Greatest travel of sliding doors [m].
_DOOR_TRAVEL = 1.57  # Greatest travel of hinged doors [rad].

DRAWER_OPENING = 0.2  # Opening at which a drawer counts as wide open [m].
SLIDING_OPENING = 0.2  # Opening at which a sliding door counts as wide open [m].
DOOR_OPENING = 0.9  # Opening at which a hinged door counts as wide open [rad].
KNOB_ANGLE = -0.88  # Angle at which a knob counts as on [rad].
SWITCH_ANGLE = -0.69  # Angle at which a switch counts as on [rad].

_STIFF_FRICTION = (0.99, 0.999, 0.001)  # `solimpfriction` of slides and hinges, as of `cabinet.Cabinet`.
_ROOM = CLEARANCE + KNOB_RADIUS  # Room before fixtures of boxes that handles take up [m].

_BASE_DEPTH = 0.5  # Depth of parametric fixtures below a counter, and of tall ones [m].
_WALL_DEPTH = 0.32  # Depth of parametric fixtures above a counter [m].

_TALL_BOTTOM = -0.75  # Lower edge of a tall cabinet, from the counter's height up [m].
_TALL_TOP = 0.85  # Upper edge of a tall cabinet, from the counter's height up [m].

# Height of doors' handles in the frame of their fixture, by its level [m].
_HANDLE_HEIGHTS = {"base": -WORKTOP - CORNER, "wall": CORNER, "tall": 0.2}

# Colours that do not depend on the style: red, green and blue from 0 to 1.
DARK = (0.12, 0.12, 0.13)  # Of windows, cooktops and plinths.
STEEL = (0.72, 0.73, 0.75)  # Of stoves.


class Style(NamedTuple):
    """Colours of a kitchen: red, green and blue from 0 to 1.

    Attributes:
      front: of drawers and doors.
      carcass: of the boxes behind them.
      worktop: of the worktops.
      metal: of handles.
      wall: of the walls.
    """

    front: Vector
    carcass: Vector
    worktop: Vector
    metal: Vector
    wall: Vector


_COLOURS = {
    "slate": ((0.36, 0.47, 0.53), (0.80, 0.79, 0.76), (0.55, 0.40, 0.26), (0.80, 0.80, 0.82), (0.89, 0.88, 0.85)),
    "oak": ((0.72, 0.55, 0.36), (0.86, 0.83, 0.77), (0.22, 0.22, 0.23), (0.20, 0.20, 0.21), (0.83, 0.85, 0.84)),
    "white": ((0.92, 0.91, 0.88), (0.85, 0.84, 0.81), (0.62, 0.62, 0.60), (0.72, 0.58, 0.35), (0.66, 0.74, 0.78)),
    "sage": ((0.55, 0.62, 0.50), (0.88, 0.87, 0.82), (0.80, 0.72, 0.60), (0.75, 0.60, 0.36), (0.93, 0.90, 0.83)),
    "navy": ((0.16, 0.22, 0.34), (0.75, 0.75, 0.76), (0.90, 0.89, 0.87), (0.82, 0.82, 0.84), (0.86, 0.83, 0.76)),
    "terracotta": ((0.68, 0.40, 0.30), (0.90, 0.86, 0.80), (0.36, 0.28, 0.22), (0.30, 0.28, 0.27), (0.92, 0.87, 0.78)),
}

STYLES: Mapping[str, Style] = MappingProxyType({name: Style(*colours) for name, colours in _COLOURS.items()})
"""Styles by name."""


@dataclasses.dataclass(frozen=True)
class Part:
    """A part of a fixture that a task may move.

    Attributes:
      kind: one of `PART_KINDS`.
      joint: name of its joint; None for a free object.
      handle: name of the site at which the robot moves it.
      opened: position of the joint at which the part counts as wide open, or on [rad, m]; it is closed, or off, at 0.
      words: the part in words, such as `top drawer`.
      follower: name of a joint that an equality constraint couples to this one.
      ratio: position of that joint for one unit of this one.
      twin: task of the kitchen domain that moves such a part in the same way; None if there is none.
    """

    kind: str
    joint: str | None
    handle: str
    opened: float
    words: str
    _: dataclasses.KW_ONLY
    follower: str | None = None
    ratio: float = 0.0
    twin: str | None = None


class Extent(NamedTuple):
    """A box in a fixture's frame: what the fixture takes up when it is closed, with its handles [m].

    The handle of `wall_sliding` reaches up to 24 mm farther. Certificates measure the parts themselves.

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class FixtureDesign:
    """Kind, sizes and options of a fixture; options that its kind does not have are None.

    Attributes:
      kind: key of `KINDS`.
      width: along the row [m].
      height: of its fronts, or of a wall cabinet [m].
      count: number of drawers, doors or knobs.
      handle: one of `HANDLES`.
      hinge: side on which a single door is hinged, or from which a sliding door slides away: `left` or `right`.
      gap: free space to its left in the row [m].
    """

    kind: str
    width: float | None = None
    height: float | None = None
    count: int | None = None
    handle: str | None = None
    hinge: str | None = None
    gap: float = 0.0

    @property
    def extent(self) -> Extent:
        """Box that the fixture takes up, in its frame."""
        return KINDS[self.kind].extent(self)


class Fixture(Prop):
    """A fixture of boxes, built from its design.

    Attributes:
      parts: that move, from top to bottom and from left to right.
    """

    parts: tuple[Part, ...] = ()

    def _build(self, *, design: FixtureDesign, style: Style, visuals: bool, name: str) -> None:
        """Builds the fixture of a design in a style; `name` is the prefix of its elements in a scene.

        Without `visuals` it has no visual geoms; the physics stays the same to the bit.
        """
        self._mjcf_root = assets.new_model(name)
        self._add_defaults(style)
        self._body = self._mjcf_root.worldbody.add("body", name="carcass")
        self._level = KINDS[design.kind].level
        _, depth, top = design.extent.high
        self._furnish(design, design.extent.width, depth, design.extent.low[2], top)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

    def _furnish(self, design: FixtureDesign, width: float, depth: float, bottom: float, top: float) -> None:
        """Adds the boxes and the parts, from the bottom to the top [m]."""
        raise NotImplementedError

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        return tuple(self._mjcf_root.find("joint", part.joint) for part in self.parts)

    def _add_defaults(self, style: Style) -> None:
        top = self._mjcf_root.default
        visual = top.add("default", dclass="visual")
        visual.geom.set_attributes(group=1, contype=0, conaffinity=0, mass=0)
        # Contype 0: no contacts among parts of the furniture. The robot and the kettle, of contype 1, still collide.
        collision = top.add("default", dclass="collision")
        collision.geom.set_attributes(
            group=4, contype=0, conaffinity=1, margin=0.001, solimp=(0.8, 0.9, 0.01), solref=(0.02, 1), mass=0
        )
        asset = self._mjcf_root.asset
        for part, shine in (("front", 0.3), ("carcass", 0.1), ("worktop", 0.25), ("metal", 0.8)):
            rgba = (*getattr(style, part), 1)
            asset.add("material", name=part, rgba=rgba, specular=shine, shininess=shine)
        for name, color in (("dark", DARK), ("steel", STEEL)):
            asset.add("material", name=name, rgba=(*color, 1), specular=0.3, shininess=0.5)

    def _add_geoms(
        self, body: mjcf.Element, name: str, material: str, physical: Mapping[str, Any], **shape: Any
    ) -> None:
        """Adds a colliding geom with physical attributes, and a visual one of the same shape."""
        body.add("geom", name=name, dclass="collision", **physical, **shape)
        body.add("geom", name=f"{name}_visual", dclass="visual", material=material, **shape)

    def _add_box(
        self, body: mjcf.Element, name: str, low: Vector, high: Vector, material: str, mass: float = 0.0
    ) -> None:
        """Adds a box between two corners, with a mass [kg]."""
        pos, size = np.add(low, high) / 2, np.subtract(high, low) / 2
        self._add_geoms(body, name, material, {"mass": mass}, type="box", pos=pos, size=size)

    def _add_carcass(self, low: Vector, high: Vector) -> None:
        """Adds an open box behind the fronts: sides, floor, top and back."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        y0 += PANEL
        self._add_box(self._body, "left_side", (x0, y0, z0), (x0 + PANEL, y1, z1), "carcass")
        self._add_box(self._body, "right_side", (x1 - PANEL, y0, z0), (x1, y1, z1), "carcass")
        inner = x0 + PANEL, x1 - PANEL
        self._add_box(self._body, "bottom", (inner[0], y0, z0), (inner[1], y1, z0 + PANEL), "carcass")
        self._add_box(self._body, "top", (inner[0], y0, z1 - PANEL), (inner[1], y1, z1), "carcass")
        self._add_box(self._body, "back", (inner[0], y1 - PANEL, z0), (inner[1], y1, z1), "carcass")

    def _add_worktop(self, width: float, depth: float, height: float) -> None:
        """Adds a worktop whose upper face is at a height."""
        low, high = (-width / 2, -0.01, height - WORKTOP), (width / 2, depth, height)
        self._add_box(self._body, "worktop", low, high, "worktop")

    def _add_part(
        self, kind: str, name: str, opened: float, words: str, *, joint: Mapping[str, Any], **place: Any
    ) -> mjcf.Element:
        """Adds a part whose joint has its name; returns its body, without geoms and handle."""
        body = self._body.add("body", name=name, **place)
        body.add("joint", name=name, solimpfriction=_STIFF_FRICTION, armature=0.01, **joint)
        self.parts = (*self.parts, Part(kind, name, f"{name}_handle", opened, words))
        return body

    def _add_handle(self, body: mjcf.Element, kind: str | None, pos: Vector, *, upright: bool) -> None:
        """Adds the handle of a part, with its centre before a place on the front, in the body's frame [m].

        Its site has z into the fixture and y along the bar.
        """
        x, y, z = pos
        front, y = y, y - CLEARANCE
        shapes: dict[str, dict[str, Any]] = {}
        if kind == "bar":
            dx, dz = (0.0, BAR_HALF_LENGTH) if upright else (BAR_HALF_LENGTH, 0.0)
            shapes["bar"] = {"type": "capsule", "size": (BAR_RADIUS,), "fromto": (x - dx, y, z - dz, x + dx, y, z + dz)}
            for end, sign in (("a", -1), ("b", 1)):
                foot = (x + sign * dx, y, z + sign * dz, x + sign * dx, front, z + sign * dz)
                shapes[f"post_{end}"] = {"type": "capsule", "size": (0.7 * BAR_RADIUS,), "fromto": foot}
        else:
            shapes["ball"] = {"type": "sphere", "size": (KNOB_RADIUS,), "pos": (x, y, z)}
            shapes["post"] = {"type": "capsule", "size": (0.5 * KNOB_RADIUS,), "fromto": (x, y, z, x, front, z)}
        name = f"{body.name}_handle"
        for shape, attributes in shapes.items():
            self._add_geoms(body, f"{name}_{shape}", "metal", {"friction": (1.0, 0.005, 0.0001)}, **attributes)
        frame = (-1, 0, 0, 0, 0, 1) if upright else (0, 0, 1, 1, 0, 0)
        body.add("site", name=name, pos=(x, y, z), xyaxes=frame, size=(0.008,), group=3)


class Drawers(Fixture):
    """Drawers below a worktop, one above the other."""

    def _furnish(self, design: FixtureDesign, width: float, depth: float, bottom: float, top: float) -> None:
        self._add_worktop(width, depth, top)
        self._add_carcass((-width / 2, 0, bottom), (width / 2, depth, -WORKTOP))
        count = design.count or 1
        height, half = (-bottom - WORKTOP) / count, width / 2 - PANEL - GAP
        joint = {"type": "slide", "axis": (0, -1, 0), "range": (0, _DRAWER_TRAVEL), "damping": 8, "frictionloss": 2}
        for number in range(count):
            name = f"drawer_{number + 1}"
            words = _numbered("drawer", number, count)
            top = -WORKTOP - number * height
            body = self._add_part("drawer", name, DRAWER_OPENING, words, joint=joint)
            low, high = (-width / 2 + GAP, 0, top - height + GAP / 2), (width / 2 - GAP, PANEL, top - GAP / 2)
            self._add_box(body, name, low, high, "front", 0.8)
            back, floor = depth - 2 * PANEL, top - height + PANEL + GAP
            rim = max(top - 0.3 * height, floor + 0.01)
            self._add_box(body, f"{name}_floor", (-half, PANEL, floor), (half, back, floor + 0.01), "carcass", 0.4)
            for side, x in (("left", -half), ("right", half - 0.01)):
                self._add_box(body, f"{name}_{side}", (x, PANEL, floor), (x + 0.01, back, rim), "carcass", 0.1)
            self._add_handle(body, design.handle, (0, 0, top - height / 2), upright=False)


class Doors(Fixture):
    """One or two hinged doors, of a base cabinet with a worktop, a wall cabinet or a tall one."""

    def _furnish(self, design: FixtureDesign, width: float, depth: float, bottom: float, top: float) -> None:
        if self._level == "base":
            self._add_worktop(width, depth, top)
            top -= WORKTOP
        self._add_carcass((-width / 2, 0, bottom), (width / 2, depth, top))
        sides = ("left", "right") if design.count == 2 else (design.hinge or "left",)
        span = width / len(sides) - 2 * GAP
        low, high = bottom + GAP, top - GAP
        mass = max(0.5, 6.0 * span * (high - low))
        for side in sides:
            words = "door" if len(sides) == 1 else f"{side} door"
            # Of the side of the hinges, from which the door swings towards who stands before it.
            sign = 1 if side == "left" else -1
            swing = {"axis": (0, 0, 1), "range": (-_DOOR_TRAVEL, 0) if sign > 0 else (0, _DOOR_TRAVEL)}
            joint = {"type": "hinge", **swing, "damping": 0.8, "frictionloss": 0.6}
            pos = (-sign * (width / 2 - GAP), PANEL / 2, 0)
            body = self._add_part("door", f"{side}_door", -sign * DOOR_OPENING, words, joint=joint, pos=pos)
            ends = sorted((0.0, sign * span))
            self._add_box(body, body.name, (ends[0], -PANEL / 2, low), (ends[1], PANEL / 2, high), "front", mass)
            place = (sign * (span - EDGE), -PANEL / 2, _HANDLE_HEIGHTS[self._level])
            self._add_handle(body, design.handle, place, upright=True)


class SlidingDoor(Fixture):
    """A wall cabinet with a door before one half, which slides before the other half."""

    def _furnish(self, design: FixtureDesign, width: float, depth: float, bottom: float, top: float) -> None:
        self._add_carcass((-width / 2, 0, 0), (width / 2, depth, top))
        sign = 1 if design.hinge == "left" else -1
        fixed = sorted((0.0, sign * (width / 2 - GAP)))
        self._add_box(self._body, "panel", (fixed[0], 0, GAP), (fixed[1], PANEL, top - GAP), "front")
        travel = min(_SLIDING_TRAVEL, width / 2 - EDGE)
        slide = {"axis": (1, 0, 0), "range": (0, travel) if sign > 0 else (-travel, 0)}
        joint = {"type": "slide", **slide, "damping": 2, "frictionloss": 2}
        opened = sign * min(SLIDING_OPENING, 0.8 * travel)
        body = self._add_part("sliding door", "door", opened, "sliding door", joint=joint)
        ends = sorted((-sign * (width / 2 - GAP), 0.0))
        self._add_box(body, "door", (ends[0], -PANEL - GAP, GAP), (ends[1], -GAP, top - GAP), "front", 1.0)
        self._add_handle(body, design.handle, (-sign * (width / 2 - EDGE - GAP), -PANEL - GAP, CORNER), upright=True)


class Stove(Fixture):
    """A stove below a cooktop, with knobs in its front."""

    def _furnish(self, design: FixtureDesign, width: float, depth: float, bottom: float, top: float) -> None:
        self._add_box(self._body, "top", (-width / 2, -0.01, -WORKTOP), (width / 2, depth, 0), "dark")
        low, high = (-width / 2 + GAP, 0, bottom), (width / 2 - GAP, depth, -WORKTOP)
        self._add_box(self._body, "case", low, high, "steel")
        window = (-0.35 * width, -0.004, 0.9 * bottom), (0.35 * width, 0, 0.4 * bottom)
        self._add_box(self._body, "window", *window, "dark")
        count = design.count or 1
        step = min(0.15, (width - 0.1) / count)
        for number in range(count):
            words = _numbered("knob", number, count, ("left", "middle", "right"))
            self._add_knob(f"knob_{number + 1}", words, (number - (count - 1) / 2) * step)
        for x in (-0.22 * width, 0.22 * width):
            for y in (0.27 * depth, 0.73 * depth):
                for radius, height, material in ((0.09, 0.002, "steel"), (0.08, 0.003, "dark")):
                    plate = {"type": "cylinder", "size": (radius, height), "pos": (x, y, 0)}
                    self._body.add("geom", dclass="visual", material=material, **plate)

    def _add_knob(self, name: str, words: str, x: float) -> None:
        """Adds a knob like those of the oven, whose bar is upright while it is off."""
        joint = {"type": "hinge", "axis": (0, 0, 1), "range": (-1.57, 0), "damping": 0.4, "frictionloss": 0.1}
        place = {"pos": (x, 0, -WORKTOP - 0.07), "xyaxes": (1, 0, 0, 0, 0, 1)}
        body = self._add_part("knob", name, KNOB_ANGLE, words, joint=joint, **place)
        mass, bar = {"mass": 0.01}, (0, 0, 0.038)
        self._add_geoms(body, f"{name}_bar", "dark", mass, type="box", pos=bar, size=(0.014, 0.048, 0.018))
        self._add_geoms(body, f"{name}_disc", "steel", mass, type="cylinder", pos=(0, 0, 0.013), size=(0.05, 0.008))
        body.add("site", name=f"{name}_handle", pos=bar, size=(0.01,), group=3)


def _numbered(noun: str, number: int, count: int, ends: Sequence[str] = ("top", "middle", "bottom")) -> str:
    """Returns a part in words: alone, the first, the last, or one between them by its number."""
    if count == 1:
        return noun
    first, middle, last = ends
    between = (middle,) if count == 3 else ("second", "third")[: count - 2]
    return f"{(first, *between, last)[number]} {noun}"


# The kitchen's own props, whose parts have names of their own.
_OVEN_PARTS = tuple(
    Part("knob", f"knob_Joint_{knob}", f"knob_{knob}", KNOB_ANGLE, words, follower=follower, ratio=1 / 174, twin=twin)
    for knob, words, follower, twin in (
        (4, "upper left knob", "top_left_burner", "top burner"),
        (3, "upper right knob", "top_right_burner", "top right burner"),
        (2, "lower left knob", "bottom_left_burner", "bottom burner"),
        (1, "lower right knob", "bottom_right_burner", "bottom right burner"),
    )
)
_LIGHT: dict[str, Any] = {"follower": "light_joint", "ratio": 1 / 14, "twin": "light switch"}
_SWITCH = Part("switch", "light_switch", "switch", SWITCH_ANGLE, "light switch", **_LIGHT)
_MICROWAVE_DOOR = Part("door", "microwave", "handle", -0.75, "door", twin="microwave")
# The left door is in reach in few places only.
_RIGHT_DOOR = Part("door", "right_hinge_cabinet", "right_handle", 1.3, "right door", twin="hinge cabinet")
_SLIDING_DOOR = Part("sliding door", "slide_cabinet", "handle", 0.33, "sliding door", twin="slide cabinet")
KETTLE = Part("kettle", None, "handle", 0.4, "kettle", twin="kettle")
"""The kettle, which counts as moved when it has come 0.4 m back, to the next burner."""


@dataclasses.dataclass(frozen=True)
class FixtureKind:
    """A kind of fixture of boxes.

    Attributes:
      entity: its class.
      level: where it stands: `base` below the counter, `counter` on it, `wall` above it, `tall` beside it.
      words: the fixture in words.
      options: bounds `(low, high)` of numbers, or choices, by the names of the design's options.
    """

    entity: type[Prop]
    level: str
    words: str
    options: Mapping[str, tuple[Any, ...]] = dataclasses.field(default_factory=dict)

    @property
    def origin(self) -> Vector:
        """Position of the entity's frame in the fixture's frame [m]."""
        return 0.0, 0.0, 0.0

    def build(self, design: FixtureDesign, style: Style, visuals: bool, name: str) -> Prop:
        """Builds the entity of a design in a style; `name` is the prefix of its elements in a scene."""
        return self.entity(design=design, style=style, visuals=visuals, name=name)

    def extent(self, design: FixtureDesign) -> Extent:
        """Returns what a fixture takes up, in its frame."""
        assert design.width is not None
        height, depth = design.height or 0.0, _WALL_DEPTH if self.level == "wall" else _BASE_DEPTH
        bottom, top = {"base": (-height, 0.0), "wall": (0.0, height), "tall": (_TALL_BOTTOM, _TALL_TOP)}[self.level]
        return Extent((-design.width / 2, -_ROOM, bottom), (design.width / 2, depth, top))

    def parts_of(self, prop: Prop) -> tuple[Part, ...]:
        """Returns the parts of an entity of this kind."""
        assert isinstance(prop, Fixture)
        return prop.parts


@dataclasses.dataclass(frozen=True)
class KitchenPropKind(FixtureKind):
    """A prop of the kitchen as a fixture, in whose style its lacquer is painted.

    Attributes:
      low, high: corners of what it takes up, in its own frame [m].
      parts: that move.
      room: for handles, before the box [m].
    """

    _: dataclasses.KW_ONLY
    low: Vector
    high: Vector
    parts: tuple[Part, ...]
    room: float = 0.0

    @property
    def origin(self) -> Vector:
        # The kitchen's counter is 1.6 m above the frame of its oven.
        height = 1.6 if self.level == "base" else self.low[2]
        return -(self.low[0] + self.high[0]) / 2, -self.low[1], -height

    def build(self, design: FixtureDesign, style: Style, visuals: bool, name: str) -> Prop:
        built = self.entity(visuals=visuals, name=name)
        lacquer = built.mjcf_model.find("material", "lacquer")
        if lacquer is not None:
            lacquer.rgba = (*style.front, 1)
        return built

    def extent(self, design: FixtureDesign) -> Extent:
        (x, y, z), high = (tuple(np.add(corner, self.origin).tolist()) for corner in (self.low, self.high))
        return Extent((x, y - self.room, z), high)

    def parts_of(self, prop: Prop) -> tuple[Part, ...]:
        return self.parts


_COUNT = (1, 2, 3, 4)  # Possible numbers of drawers or knobs.

# Options of every fixture with doors.
_DOOR = {"handle": HANDLES, "hinge": ("left", "right")}

KINDS: Mapping[str, FixtureKind] = MappingProxyType(
    {
        "drawers": FixtureKind(
            Drawers, "base", "cabinet", {"width": (0.3, 0.9), "height": (0.16, 0.6), "count": _COUNT, "handle": HANDLES}
        ),
        "base_doors": FixtureKind(
            Doors, "base", "cabinet", {"width": (0.3, 0.9), "height": (0.3, 0.7), "count": (1, 2), **_DOOR}
        ),
        "stove": FixtureKind(
            Stove, "base", "stove", {"width": (0.45, 0.9), "height": (0.4, 0.7), "count": _COUNT}
        ),
        "wall_doors": FixtureKind(
            Doors, "wall", "wall cabinet", {"width": (0.3, 0.9), "height": (0.3, 0.6), "count": (1, 2), **_DOOR}
        ),
        "wall_sliding": FixtureKind(
            SlidingDoor, "wall", "wall cabinet", {"width": (0.5, 0.9), "height": (0.3, 0.6), **_DOOR}
        ),
        "tall_door": FixtureKind(Doors, "tall", "tall cabinet", {"width": (0.3, 0.6), **_DOOR}),
        "oven": KitchenPropKind(
            props.Oven, "base", "oven", low=(-0.402, -0.704, 0.0), high=(0.598, 0.613, 2.39), parts=_OVEN_PARTS
        ),
        "hood": KitchenPropKind(
            props.Hood, "wall", "hood", low=(-0.402, -0.179, 2.164), high=(0.602, 0.597, 2.404), parts=(_SWITCH,)
        ),
        "hinge_cabinet": KitchenPropKind(
            props.HingeCabinet, "wall", "hinge cabinet",
            low=(-0.4, -0.35, -0.2), high=(0.4, 0.3, 0.2), parts=(_RIGHT_DOOR,), room=0.12,
        ),
        "slide_cabinet": KitchenPropKind(
            props.SlideCabinet, "wall", "slide cabinet",
            low=(-0.45, -0.36, -0.2), high=(0.45, 0.3, 0.2), parts=(_SLIDING_DOOR,), room=0.11,
        ),
        "microwave": KitchenPropKind(
            props.Microwave, "counter", "microwave",
            low=(-0.345, -0.221, 0.0), high=(0.345, 0.222, 0.374), parts=(_MICROWAVE_DOOR,), room=0.1,
        ),
    }
)  # fmt: skip
"""The kinds of fixtures by name."""

"""Fixtures of generated kitchens: parametric cabinets and stoves from boxes, and the kitchen's own props.

A fixture's frame has its origin in the middle of its front, x to the right of who stands before it, y into it, z up.
The origin is at the upper edge of a fixture below a counter, and of a tall one at the counter's height; that of others
is at the lower edge. Each fixture has an extent, and parts that move: drawers, doors, knobs, a switch.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from dm_control import mjcf

from kitchen_suite.entities import assets
from kitchen_suite.entities import props as kitchen_props
from kitchen_suite.entities.assets import Vector
from kitchen_suite.entities.joints import JointObservables
from kitchen_suite.entities.props import Prop

# Kinds of parts.
PART_KINDS = ("drawer", "door", "sliding door", "knob", "switch", "kettle")

# Handles of parametric fixtures.
HANDLES = ("bar", "knob")

# Gap between fronts, and from a front to the edge of its fixture [m].
GAP = 0.004

# Thickness of panels and of worktops [m].
PANEL, WORKTOP = 0.02, 0.03

# Of handles: distance of the bar's axis from the front, radius and half length of a bar, radius of a knob [m].
CLEARANCE, BAR_RADIUS, BAR_HALF_LENGTH, KNOB_RADIUS = 0.06, 0.01, 0.06, 0.018

# Distance of a door's handle from its free edge, and from its upper or lower edge [m].
EDGE, CORNER = 0.05, 0.1

# Greatest travel of drawers and doors [m, rad].
_DRAWER_TRAVEL, _SLIDING_TRAVEL, _DOOR_TRAVEL = 0.3, 0.26, 1.57

# Opening at which a part counts as wide open [m, rad].
DRAWER_OPENING, SLIDING_OPENING, DOOR_OPENING, KNOB_ANGLE, SWITCH_ANGLE = 0.2, 0.2, 0.9, -0.88, -0.69

# `solimpfriction` of slides and hinges, as of `cabinet.Cabinet`.
_STIFF_FRICTION = (0.99, 0.999, 0.001)


# Colours that do not depend on the style: of windows, cooktops and plinths, and of stoves.
DARK, STEEL = (0.12, 0.12, 0.13), (0.72, 0.73, 0.75)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Style:
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


STYLES: Mapping[str, Style] = MappingProxyType(
    {
        "slate": Style(
            front=(0.36, 0.47, 0.53),
            carcass=(0.80, 0.79, 0.76),
            worktop=(0.55, 0.40, 0.26),
            metal=(0.80, 0.80, 0.82),
            wall=(0.89, 0.88, 0.85),
        ),
        "oak": Style(
            front=(0.72, 0.55, 0.36),
            carcass=(0.86, 0.83, 0.77),
            worktop=(0.22, 0.22, 0.23),
            metal=(0.20, 0.20, 0.21),
            wall=(0.83, 0.85, 0.84),
        ),
        "white": Style(
            front=(0.92, 0.91, 0.88),
            carcass=(0.85, 0.84, 0.81),
            worktop=(0.62, 0.62, 0.60),
            metal=(0.72, 0.58, 0.35),
            wall=(0.66, 0.74, 0.78),
        ),
        "sage": Style(
            front=(0.55, 0.62, 0.50),
            carcass=(0.88, 0.87, 0.82),
            worktop=(0.80, 0.72, 0.60),
            metal=(0.75, 0.60, 0.36),
            wall=(0.93, 0.90, 0.83),
        ),
        "navy": Style(
            front=(0.16, 0.22, 0.34),
            carcass=(0.75, 0.75, 0.76),
            worktop=(0.90, 0.89, 0.87),
            metal=(0.82, 0.82, 0.84),
            wall=(0.86, 0.83, 0.76),
        ),
        "terracotta": Style(
            front=(0.68, 0.40, 0.30),
            carcass=(0.90, 0.86, 0.80),
            worktop=(0.36, 0.28, 0.22),
            metal=(0.30, 0.28, 0.27),
            wall=(0.92, 0.87, 0.78),
        ),
    }
)
"""Styles by name."""


@dataclasses.dataclass(frozen=True, kw_only=True)
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
    follower: str | None = None
    ratio: float = 0.0
    twin: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Extent:
    """A box in a fixture's frame: what the fixture takes up when it is closed, without handles [m].

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


class Fixture(Prop):
    """A fixture of boxes, built from its sizes."""

    _parts: tuple[Part, ...]

    def _build(self, *, style: Style, visuals: bool = True, name: str, **sizes: Any) -> None:
        """Builds the fixture.

        Args:
          style: its colours.
          visuals: `False` leaves out the visual geoms; the physics stays the same to the bit.
          name: prefix of its elements in a scene.
          **sizes: of the class; see `KINDS`.
        """
        self._mjcf_root = assets.new_model(name)
        self._parts = ()
        self._add_defaults(style)
        self._body = self._mjcf_root.worldbody.add("body", name="carcass")
        self._furnish(**sizes)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

    def _furnish(self, **sizes: Any) -> None:
        raise NotImplementedError

    def _build_observables(self) -> JointObservables:
        return JointObservables(self)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts that move, from top to bottom and from left to right."""
        return self._parts

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        return tuple(self._mjcf_root.find("joint", part.joint) for part in self._parts)

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

    def _add_box(
        self, body: mjcf.Element, name: str, low: Vector, high: Vector, material: str, mass: float = 0.0
    ) -> None:
        """Adds a box between two corners: a colliding geom with the mass [kg], and a visual one."""
        pos = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
        size = tuple((b - a) / 2 for a, b in zip(low, high, strict=True))
        body.add("geom", name=name, dclass="collision", type="box", pos=pos, size=size, mass=mass)
        body.add("geom", name=f"{name}_visual", dclass="visual", type="box", pos=pos, size=size, material=material)

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

    def _add_part(self, part: Part, body: mjcf.Element, **joint: Any) -> None:
        body.add("joint", name=part.joint, solimpfriction=_STIFF_FRICTION, armature=0.01, **joint)
        self._parts = (*self._parts, part)

    def _add_handle(self, body: mjcf.Element, name: str, kind: str, pos: Vector, *, upright: bool) -> None:
        """Adds a handle before a front; its site has z into the fixture and y along the bar.

        Args:
          body: of the front.
          name: of the site, and of the geoms' names the beginning.
          kind: one of `HANDLES`.
          pos: of its centre on the front, in the body's frame [m].
          upright: whether the bar is upright.
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
        for shape, attributes in shapes.items():
            body.add("geom", name=f"{name}_{shape}", dclass="collision", friction=(1.0, 0.005, 0.0001), **attributes)
            body.add("geom", name=f"{name}_{shape}_visual", dclass="visual", material="metal", **attributes)
        frame = (-1, 0, 0, 0, 0, 1) if upright else (0, 0, 1, 1, 0, 0)
        body.add("site", name=name, pos=(x, y, z), xyaxes=frame, size=(0.008,), group=3)


class Drawers(Fixture):
    """Drawers below a worktop, one above the other."""

    def _furnish(self, width: float, depth: float, height: float, count: int, handle: str) -> None:
        self._add_worktop(width, depth, 0.0)
        self._add_carcass((-width / 2, 0, -height), (width / 2, depth, -WORKTOP))
        step = (height - WORKTOP) / count
        for number in range(count):
            self._add_drawer(number, -WORKTOP - number * step, width, depth, step, count, handle)

    def _add_drawer(
        self, number: int, top: float, width: float, depth: float, height: float, count: int, handle: str
    ) -> None:
        name, half = f"drawer_{number + 1}", width / 2 - PANEL - GAP
        body = self._body.add("body", name=name)
        part = Part(
            kind="drawer",
            joint=name,
            handle=f"{name}_handle",
            opened=DRAWER_OPENING,
            words=_numbered("drawer", number, count),
        )
        self._add_part(part, body, type="slide", axis=(0, -1, 0), range=(0, _DRAWER_TRAVEL), damping=8, frictionloss=2)
        low, high = (-width / 2 + GAP, 0, top - height + GAP / 2), (width / 2 - GAP, PANEL, top - GAP / 2)
        self._add_box(body, name, low, high, "front", 0.8)
        back, floor, rim = depth - 2 * PANEL, top - height + PANEL + GAP, top - 0.3 * height
        self._add_box(body, f"{name}_floor", (-half, PANEL, floor), (half, back, floor + 0.01), "carcass", 0.4)
        for side, x in (("left", -half), ("right", half - 0.01)):
            self._add_box(body, f"{name}_{side}", (x, PANEL, floor), (x + 0.01, back, rim), "carcass", 0.1)
        self._add_handle(body, part.handle, handle, (0, 0, top - height / 2), upright=False)


class Doors(Fixture):
    """One or two hinged doors, of a base cabinet with a worktop, a wall cabinet or a tall one."""

    def _furnish(
        self,
        width: float,
        depth: float,
        bottom: float,
        top: float,
        handle_height: float,
        count: int,
        handle: str,
        hinge: str,
        worktop: bool,
    ) -> None:
        if worktop:
            self._add_worktop(width, depth, top)
            top -= WORKTOP
        self._add_carcass((-width / 2, 0, bottom), (width / 2, depth, top))
        sides = ("left", "right") if count == 2 else (hinge,)
        for side in sides:
            words = "door" if count == 1 else f"{side} door"
            span = width / count - 2 * GAP
            x = -width / 2 + GAP if side == "left" else width / 2 - GAP
            self._add_door(side, x, span, (bottom + GAP, top - GAP), handle_height, handle, words)

    def _add_door(
        self, side: str, hinge: float, span: float, z: tuple[float, float], height: float, handle: str, words: str
    ) -> None:
        """Adds a door that is hinged on a side, at x of `hinge`, and as wide as `span` [m]."""
        name, sign = f"{side}_door", 1 if side == "left" else -1
        body = self._body.add("body", name=name, pos=(hinge, PANEL / 2, 0))
        part = Part(kind="door", joint=name, handle=f"{name}_handle", opened=-sign * DOOR_OPENING, words=words)
        # The door swings towards who stands before it.
        joint_range = (-_DOOR_TRAVEL, 0) if sign > 0 else (0, _DOOR_TRAVEL)
        self._add_part(part, body, type="hinge", axis=(0, 0, 1), range=joint_range, damping=0.8, frictionloss=0.6)
        ends = sorted((0.0, sign * span))
        mass = max(0.5, 6.0 * span * (z[1] - z[0]))
        self._add_box(body, name, (ends[0], -PANEL / 2, z[0]), (ends[1], PANEL / 2, z[1]), "front", mass)
        self._add_handle(body, part.handle, handle, (sign * (span - EDGE), -PANEL / 2, height), upright=True)


class SlidingDoor(Fixture):
    """A wall cabinet with a door before one half, which slides before the other half."""

    def _furnish(self, width: float, depth: float, height: float, handle: str, hinge: str) -> None:
        self._add_carcass((-width / 2, 0, 0), (width / 2, depth, height))
        sign = 1 if hinge == "left" else -1
        fixed = sorted((0.0, sign * (width / 2 - GAP)))
        self._add_box(self._body, "panel", (fixed[0], 0, GAP), (fixed[1], PANEL, height - GAP), "front")
        body = self._body.add("body", name="door")
        travel = min(_SLIDING_TRAVEL, width / 2 - EDGE)
        part = Part(
            kind="sliding door",
            joint="door",
            handle="door_handle",
            opened=sign * min(SLIDING_OPENING, 0.8 * travel),
            words="sliding door",
        )
        joint_range = (0, travel) if sign > 0 else (-travel, 0)
        self._add_part(part, body, type="slide", axis=(1, 0, 0), range=joint_range, damping=2, frictionloss=2)
        ends = sorted((-sign * (width / 2 - GAP), 0.0))
        low, high = (ends[0], -PANEL - GAP, GAP), (ends[1], -GAP, height - GAP)
        self._add_box(body, "door", low, high, "front", 1.0)
        pos = (-sign * (width / 2 - EDGE - GAP), -PANEL - GAP, CORNER)
        self._add_handle(body, part.handle, handle, pos, upright=True)


class Stove(Fixture):
    """A stove below a cooktop, with knobs in its front."""

    def _furnish(self, width: float, depth: float, height: float, count: int) -> None:
        self._add_box(self._body, "top", (-width / 2, -0.01, -WORKTOP), (width / 2, depth, 0), "dark")
        low, high = (-width / 2 + GAP, 0, -height), (width / 2 - GAP, depth, -WORKTOP)
        self._add_box(self._body, "case", low, high, "steel")
        window = (-0.35 * width, -0.004, -0.9 * height), (0.35 * width, 0, -0.4 * height)
        self._add_box(self._body, "window", *window, "dark")
        step = min(0.15, (width - 0.1) / count)
        for number in range(count):
            self._add_knob(number, (number - (count - 1) / 2) * step, -WORKTOP - 0.07, count)
        for x in (-0.22 * width, 0.22 * width):
            for y in (0.27 * depth, 0.73 * depth):
                for radius, height, material in ((0.09, 0.002, "steel"), (0.08, 0.003, "dark")):
                    plate = {"type": "cylinder", "size": (radius, height), "pos": (x, y, 0)}
                    self._body.add("geom", dclass="visual", material=material, **plate)

    def _add_knob(self, number: int, x: float, z: float, count: int) -> None:
        """Adds a knob like those of the oven, whose bar is upright while it is off."""
        name = f"knob_{number + 1}"
        body = self._body.add("body", name=name, pos=(x, 0, z), xyaxes=(1, 0, 0, 0, 0, 1))
        part = Part(
            kind="knob",
            joint=name,
            handle=f"{name}_handle",
            opened=KNOB_ANGLE,
            words=_numbered("knob", number, count, ("left", "middle", "right")),
        )
        self._add_part(part, body, type="hinge", axis=(0, 0, 1), range=(-1.57, 0), damping=0.4, frictionloss=0.1)
        shapes = (
            ("bar", {"type": "box", "pos": (0, 0, 0.038), "size": (0.014, 0.048, 0.018)}, "dark"),
            ("disc", {"type": "cylinder", "pos": (0, 0, 0.013), "size": (0.05, 0.008)}, "steel"),
        )
        for shape, attributes, material in shapes:
            body.add("geom", name=f"{name}_{shape}", dclass="collision", **{**attributes, "mass": 0.01})
            body.add("geom", name=f"{name}_{shape}_visual", dclass="visual", material=material, **attributes)
        body.add("site", name=part.handle, pos=(0, 0, 0.038), size=(0.01,), group=3)


def _numbered(noun: str, number: int, count: int, ends: Sequence[str] = ("top", "middle", "bottom")) -> str:
    """Returns a part in words: alone, the first, the last, or one between them by its number."""
    if count == 1:
        return noun
    if number == 0:
        return f"{ends[0]} {noun}"
    if number == count - 1:
        return f"{ends[2]} {noun}"
    ordinals = ("second", "third")
    return f"{ends[1]} {noun}" if count == 3 else f"{ordinals[number - 1]} {noun}"


# The kitchen's own props, whose parts have names of their own.
_OVEN_PARTS = tuple(
    Part(
        kind="knob",
        joint=f"knob_Joint_{knob}",
        handle=f"knob_{knob}",
        opened=KNOB_ANGLE,
        words=f"{words} knob",
        follower=f"{words.replace(' ', '_').replace('upper', 'top').replace('lower', 'bottom')}_burner",
        ratio=1 / 174,
        twin=twin,
    )
    for knob, words, twin in (
        (4, "upper left", "top burner"),
        (3, "upper right", "top right burner"),
        (2, "lower left", "bottom burner"),
        (1, "lower right", "bottom right burner"),
    )
)

_SWITCH = Part(
    kind="switch",
    joint="light_switch",
    handle="switch",
    opened=SWITCH_ANGLE,
    words="light switch",
    follower="light_joint",
    ratio=1 / 14,
    twin="light switch",
)
_MICROWAVE_DOOR = Part(kind="door", joint="microwave", handle="handle", opened=-0.75, words="door", twin="microwave")
# The left door is in reach in few places only.
_RIGHT_DOOR = Part(
    kind="door",
    joint="right_hinge_cabinet",
    handle="right_handle",
    opened=1.3,
    words="right door",
    twin="hinge cabinet",
)
_SLIDING_DOOR = Part(
    kind="sliding door", joint="slide_cabinet", handle="handle", opened=0.33, words="sliding door", twin="slide cabinet"
)
KETTLE = Part(kind="kettle", joint=None, handle="handle", opened=0.4, words="kettle", twin="kettle")
"""The kettle, which counts as moved when it has come 0.4 m back, to the next burner."""

# Room before fixtures of boxes that handles take up [m].
_ROOM = CLEARANCE + KNOB_RADIUS

# Depths of parametric fixtures below and above a counter [m].
_BASE_DEPTH, _WALL_DEPTH = 0.5, 0.32

# How far a tall cabinet reaches below and above the counter [m].
_TALL_BOTTOM, _TALL_TOP = -0.75, 0.85


@dataclasses.dataclass(frozen=True, kw_only=True)
class FixtureDesign:
    """What a fixture of a kitchen is like; an option that its kind does not have is None.

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class FixtureKind:
    """A kind of fixture.

    Attributes:
      level: where it stands: `base` below the counter, `counter` on it, `wall` above it, `tall` beside it.
      build: builds the entity from the fixture's design, a style, whether it has visuals, and its name.
      extent: returns what it takes up, in the fixture's frame.
      words: the fixture in words.
      options: bounds `(low, high)` of numbers, or choices, by the names of the design's options.
      parts: of a kitchen prop; None for a `Fixture`, which has its own.
      origin: position of the entity's frame in the fixture's frame [m].
    """

    level: str
    build: Callable[[FixtureDesign, Style, bool, str], Prop]
    extent: Callable[[FixtureDesign], Extent]
    words: str
    options: Mapping[str, tuple[Any, ...]] = dataclasses.field(default_factory=dict)
    parts: tuple[Part, ...] | None = None
    origin: Vector = (0.0, 0.0, 0.0)

    def parts_of(self, prop: Prop) -> tuple[Part, ...]:
        """Returns the parts of an entity of this kind."""
        if self.parts is not None:
            return self.parts
        assert isinstance(prop, Fixture)
        return prop.parts


def _parametric(
    entity: type[Fixture], level: str, words: str, sizes: Callable[[FixtureDesign], Mapping[str, Any]], **options: Any
) -> FixtureKind:
    """Returns a kind of fixture of boxes; `sizes` returns the arguments with which the entity is furnished."""

    def build(design: FixtureDesign, style: Style, visuals: bool, name: str) -> Prop:
        return entity(style=style, visuals=visuals, name=name, **sizes(design))

    def extent(design: FixtureDesign) -> Extent:
        assert design.width is not None
        (bottom, top), depth = _span(level, design.height), sizes(design)["depth"]
        return Extent(low=(-design.width / 2, -_ROOM, bottom), high=(design.width / 2, depth, top))

    return FixtureKind(level=level, build=build, extent=extent, words=words, options=MappingProxyType(options))


def _span(level: str, height: float | None) -> tuple[float, float]:
    """Returns the least and the greatest z of a fixture of boxes in its frame [m]."""
    if level == "tall":
        return _TALL_BOTTOM, _TALL_TOP
    assert height is not None
    return (-height, 0.0) if level == "base" else (0.0, height)


def _door_sizes(level: str) -> Callable[[FixtureDesign], Mapping[str, Any]]:
    def sizes(design: FixtureDesign) -> Mapping[str, Any]:
        bottom, top = _span(level, design.height)
        places = {"base": -WORKTOP - CORNER, "wall": CORNER, "tall": 0.2}
        return {
            "width": design.width,
            "depth": _WALL_DEPTH if level == "wall" else _BASE_DEPTH,
            "bottom": bottom,
            "top": top,
            "handle_height": places[level],
            "count": design.count or 1,
            "handle": design.handle,
            "hinge": design.hinge or "left",
            "worktop": level == "base",
        }

    return sizes


def _given(design: FixtureDesign, depth: float, *names: str) -> Mapping[str, Any]:
    return {"depth": depth, **{name: getattr(design, name) for name in names}}


def _kitchen_prop(
    prop: type[kitchen_props.KitchenProp],
    level: str,
    words: str,
    low: Vector,
    high: Vector,
    *parts: Part,
    room: float = 0.0,
) -> FixtureKind:
    """Returns the kind of a prop of the kitchen, which takes up a box in its own frame, with room for handles [m]."""
    # The kitchen's counter is 1.6 m above the frame of its oven.
    height = 1.6 if level == "base" else low[2]
    origin = (-(low[0] + high[0]) / 2, -low[1], -height)
    lower, upper = (tuple(a + b for a, b in zip(corner, origin, strict=True)) for corner in (low, high))

    def build(design: FixtureDesign, style: Style, visuals: bool, name: str) -> Prop:
        built = prop(visuals=visuals, name=name)
        lacquer = built.mjcf_model.find("material", "lacquer")
        if lacquer is not None:
            lacquer.rgba = (*style.front, 1)
        return built

    return FixtureKind(
        level=level,
        build=build,
        extent=lambda design: Extent(low=(lower[0], lower[1] - room, lower[2]), high=upper),
        words=words,
        parts=parts,
        origin=origin,
    )


_SIDES = ("left", "right")

KINDS: Mapping[str, FixtureKind] = MappingProxyType(
    {
        "drawers": _parametric(
            Drawers,
            "base",
            "cabinet",
            lambda design: _given(design, _BASE_DEPTH, "width", "height", "count", "handle"),
            width=(0.3, 0.9),
            height=(0.16, 0.6),
            count=(1, 2, 3, 4),
            handle=HANDLES,
        ),
        "base_doors": _parametric(
            Doors,
            "base",
            "cabinet",
            _door_sizes("base"),
            width=(0.3, 0.9),
            height=(0.3, 0.7),
            count=(1, 2),
            handle=HANDLES,
            hinge=_SIDES,
        ),
        "stove": _parametric(
            Stove,
            "base",
            "stove",
            lambda design: _given(design, _BASE_DEPTH, "width", "height", "count"),
            width=(0.45, 0.9),
            height=(0.4, 0.7),
            count=(1, 2, 3, 4),
        ),
        "wall_doors": _parametric(
            Doors,
            "wall",
            "wall cabinet",
            _door_sizes("wall"),
            width=(0.3, 0.9),
            height=(0.3, 0.6),
            count=(1, 2),
            handle=HANDLES,
            hinge=_SIDES,
        ),
        "wall_sliding": _parametric(
            SlidingDoor,
            "wall",
            "wall cabinet",
            lambda design: _given(design, _WALL_DEPTH, "width", "height", "handle", "hinge"),
            width=(0.5, 0.9),
            height=(0.3, 0.6),
            handle=HANDLES,
            hinge=_SIDES,
        ),
        "tall_door": _parametric(
            Doors,
            "tall",
            "tall cabinet",
            _door_sizes("tall"),
            width=(0.3, 0.6),
            handle=HANDLES,
            hinge=_SIDES,
        ),
        "oven": _kitchen_prop(
            kitchen_props.Oven, "base", "oven", (-0.402, -0.704, 0.0), (0.598, 0.613, 2.39), *_OVEN_PARTS
        ),
        "hood": _kitchen_prop(
            kitchen_props.Hood, "wall", "hood", (-0.402, -0.179, 2.164), (0.602, 0.597, 2.404), _SWITCH
        ),
        "hinge_cabinet": _kitchen_prop(
            kitchen_props.HingeCabinet,
            "wall",
            "hinge cabinet",
            (-0.4, -0.35, -0.2),
            (0.4, 0.3, 0.2),
            _RIGHT_DOOR,
            room=0.12,
        ),
        "slide_cabinet": _kitchen_prop(
            kitchen_props.SlideCabinet,
            "wall",
            "slide cabinet",
            (-0.45, -0.36, -0.2),
            (0.45, 0.3, 0.2),
            _SLIDING_DOOR,
            room=0.11,
        ),
        "microwave": _kitchen_prop(
            kitchen_props.Microwave,
            "counter",
            "microwave",
            (-0.345, -0.221, 0.0),
            (0.345, 0.222, 0.374),
            _MICROWAVE_DOOR,
            room=0.1,
        ),
    }
)
"""The kinds of fixtures by name."""

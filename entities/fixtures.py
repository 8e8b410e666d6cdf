"""Fixtures of generated kitchens, built from their designs: cabinets and stoves of boxes, and props of the kitchen.

`fixture_designs` describes the frame of a fixture. A fixture has parts that move: drawers, doors, knobs, a switch.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import assets, props
from kitchen_suite.entities.fixture_designs import (
    CLEARANCE,
    KNOB_RADIUS,
    BaseDoorsDesign,
    DrawersDesign,
    Extent,
    FixtureDesign,
    Handle,
    HingeCabinetDesign,
    HoodDesign,
    KitchenPropDesign,
    Level,
    MicrowaveDesign,
    OvenDesign,
    SlideCabinetDesign,
    StoveDesign,
    TallDoorDesign,
    WallDoorsDesign,
    WallSlidingDesign,
)
from kitchen_suite.entities.props import Prop
from kitchen_suite.entities.styles import DARK, STEEL, Style
from kitchen_suite.types import Vector

PART_KINDS = ("drawer", "door", "sliding door", "knob", "switch", "kettle")  # Kinds of parts.
GAP = 0.004  # Gap between fronts, and from a front to the edge of its fixture [m].

PANEL = 0.02  # Thickness of panels [m].
WORKTOP = 0.03  # Thickness of worktops [m].

BAR_RADIUS = 0.01  # Radius of a handle's bar [m].
BAR_HALF_LENGTH = 0.06  # Half length of a handle's bar [m].

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

_STIFF_FRICTION = (0.99, 0.999, 0.001)  # `solimpfriction` of slides and hinges, as in `cabinet.Cabinet`.

# Height of doors' handles in the frame of their fixture, by its level [m].
_HANDLE_HEIGHTS: Mapping[Level, float] = {"base": -WORKTOP - CORNER, "wall": CORNER, "tall": 0.2}


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


DesignT = TypeVar("DesignT", bound=FixtureDesign)


class Fixture(Prop, Generic[DesignT]):
    """A fixture of boxes, built from its design.

    Attributes:
      parts: that move, from top to bottom and from left to right.
    """

    parts: tuple[Part, ...] = ()

    def _build(self, *, design: DesignT, style: Style, visuals: bool, name: str) -> None:
        """Builds the fixture of a design in a style; `name` is the prefix of its elements in a scene.

        Without `visuals` it has no visual geoms; the physics stays the same to the bit.
        """
        self._mjcf_root = assets.new_model(name)
        self._add_defaults(style)
        self._body = self._mjcf_root.worldbody.add("body", name="carcass")
        self._furnish(design, design.extent)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

    def _furnish(self, design: DesignT, extent: Extent) -> None:
        """Adds the boxes and the parts, within the extent of the design."""
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
        for part, color, shine in (
            ("front", style.front, 0.3),
            ("carcass", style.carcass, 0.1),
            ("worktop", style.worktop, 0.25),
            ("metal", style.metal, 0.8),
        ):
            asset.add("material", name=part, rgba=(*color, 1), specular=shine, shininess=shine)
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
        left, front, bottom = low
        right, back, top = high
        front += PANEL
        self._add_box(self._body, "left_side", (left, front, bottom), (left + PANEL, back, top), "carcass")
        self._add_box(self._body, "right_side", (right - PANEL, front, bottom), (right, back, top), "carcass")
        left += PANEL
        right -= PANEL
        self._add_box(self._body, "bottom", (left, front, bottom), (right, back, bottom + PANEL), "carcass")
        self._add_box(self._body, "top", (left, front, top - PANEL), (right, back, top), "carcass")
        self._add_box(self._body, "back", (left, back - PANEL, bottom), (right, back, top), "carcass")

    def _add_worktop(self, width: float, depth: float, height: float) -> None:
        """Adds a worktop whose upper face is at a height."""
        low = (-width / 2, -0.01, height - WORKTOP)
        high = (width / 2, depth, height)
        self._add_box(self._body, "worktop", low, high, "worktop")

    def _add_part(
        self, kind: str, name: str, opened: float, words: str, *, joint: Mapping[str, Any], **place: Any
    ) -> mjcf.Element:
        """Adds a part whose joint has its name; returns its body, without geoms and handle."""
        body = self._body.add("body", name=name, **place)
        body.add("joint", name=name, solimpfriction=_STIFF_FRICTION, armature=0.01, **joint)
        self.parts = (*self.parts, Part(kind, name, f"{name}_handle", opened, words))
        return body

    def _add_handle(self, body: mjcf.Element, kind: Handle, pos: Vector, *, upright: bool) -> None:
        """Adds the handle of a part, with its centre before a place on the front, in the body's frame [m].

        Its site has z into the fixture and y along the bar.
        """
        x, front, z = pos
        y = front - CLEARANCE
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


class Drawers(Fixture[DrawersDesign]):
    """Drawers below a worktop, one above the other."""

    def _furnish(self, design: DrawersDesign, extent: Extent) -> None:
        half_width = design.width / 2
        self._add_worktop(design.width, extent.depth, extent.top)
        self._add_carcass((-half_width, 0, extent.bottom), (half_width, extent.depth, -WORKTOP))
        height = (design.height - WORKTOP) / design.count
        inner = half_width - PANEL - GAP
        back = extent.depth - 2 * PANEL
        joint = {"type": "slide", "axis": (0, -1, 0), "range": (0, _DRAWER_TRAVEL), "damping": 8, "frictionloss": 2}
        for number in range(design.count):
            name = f"drawer_{number + 1}"
            words = _numbered("drawer", number, design.count)
            body = self._add_part("drawer", name, DRAWER_OPENING, words, joint=joint)
            top = -WORKTOP - number * height
            low = (-half_width + GAP, 0, top - height + GAP / 2)
            high = (half_width - GAP, PANEL, top - GAP / 2)
            self._add_box(body, name, low, high, "front", 0.8)
            floor = top - height + PANEL + GAP
            rim = max(top - 0.3 * height, floor + 0.01)
            self._add_box(body, f"{name}_floor", (-inner, PANEL, floor), (inner, back, floor + 0.01), "carcass", 0.4)
            for side, x in (("left", -inner), ("right", inner - 0.01)):
                self._add_box(body, f"{name}_{side}", (x, PANEL, floor), (x + 0.01, back, rim), "carcass", 0.1)
            self._add_handle(body, design.handle, (0, 0, top - height / 2), upright=False)


class Doors(Fixture[BaseDoorsDesign | WallDoorsDesign | TallDoorDesign]):
    """One or two hinged doors, of a base cabinet with a worktop, a wall cabinet or a tall one."""

    def _furnish(self, design: BaseDoorsDesign | WallDoorsDesign | TallDoorDesign, extent: Extent) -> None:
        half_width = design.width / 2
        top = extent.top
        if design.level == "base":
            self._add_worktop(design.width, extent.depth, top)
            top -= WORKTOP
        self._add_carcass((-half_width, 0, extent.bottom), (half_width, extent.depth, top))
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
            body = self._add_part("door", f"{side}_door", -sign * DOOR_OPENING, words, joint=joint, pos=pos)
            left, right = sorted((0.0, sign * span))
            self._add_box(body, body.name, (left, -PANEL / 2, lower), (right, PANEL / 2, upper), "front", mass)
            place = (sign * (span - EDGE), -PANEL / 2, _HANDLE_HEIGHTS[design.level])
            self._add_handle(body, design.handle, place, upright=True)


class SlidingDoor(Fixture[WallSlidingDesign]):
    """A wall cabinet with a door before one half, which slides before the other half."""

    def _furnish(self, design: WallSlidingDesign, extent: Extent) -> None:
        half_width = design.width / 2
        self._add_carcass((-half_width, 0, 0), (half_width, extent.depth, extent.top))
        upper = extent.top - GAP
        sign = 1 if design.hinge == "left" else -1
        left, right = sorted((0.0, sign * (half_width - GAP)))
        self._add_box(self._body, "panel", (left, 0, GAP), (right, PANEL, upper), "front")
        travel = min(_SLIDING_TRAVEL, half_width - EDGE)
        slide = {"axis": (1, 0, 0), "range": (0, travel) if sign > 0 else (-travel, 0)}
        joint = {"type": "slide", **slide, "damping": 2, "frictionloss": 2}
        opened = sign * min(SLIDING_OPENING, 0.8 * travel)
        body = self._add_part("sliding door", "door", opened, "sliding door", joint=joint)
        left, right = sorted((-sign * (half_width - GAP), 0.0))
        self._add_box(body, "door", (left, -PANEL - GAP, GAP), (right, -GAP, upper), "front", 1.0)
        self._add_handle(body, design.handle, (-sign * (half_width - EDGE - GAP), -PANEL - GAP, CORNER), upright=True)


class Stove(Fixture[StoveDesign]):
    """A stove below a cooktop, with knobs in its front."""

    def _furnish(self, design: StoveDesign, extent: Extent) -> None:
        width = design.width
        depth = extent.depth
        bottom = extent.bottom
        self._add_box(self._body, "top", (-width / 2, -0.01, -WORKTOP), (width / 2, depth, 0), "dark")
        self._add_box(self._body, "case", (-width / 2 + GAP, 0, bottom), (width / 2 - GAP, depth, -WORKTOP), "steel")
        window = (-0.35 * width, -0.004, 0.9 * bottom), (0.35 * width, 0, 0.4 * bottom)
        self._add_box(self._body, "window", *window, "dark")
        step = min(0.15, (width - 0.1) / design.count)
        for number in range(design.count):
            words = _numbered("knob", number, design.count, ("left", "middle", "right"))
            self._add_knob(f"knob_{number + 1}", words, (number - (design.count - 1) / 2) * step)
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
        mass = {"mass": 0.01}
        bar = (0, 0, 0.038)
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
_SWITCH = Part(
    "switch",
    "light_switch",
    "switch",
    SWITCH_ANGLE,
    "light switch",
    follower="light_joint",
    ratio=1 / 14,
    twin="light switch",
)
_MICROWAVE_DOOR = Part("door", "microwave", "handle", -0.75, "door", twin="microwave")
# The left door is in reach in few places only.
_RIGHT_DOOR = Part("door", "right_hinge_cabinet", "right_handle", 1.3, "right door", twin="hinge cabinet")
_SLIDING_DOOR = Part("sliding door", "slide_cabinet", "handle", 0.33, "sliding door", twin="slide cabinet")
KETTLE = Part("kettle", None, "handle", 0.4, "kettle", twin="kettle")
"""The kettle, which counts as moved when it has come 0.4 m back, to the next burner."""


class BuiltFixture(NamedTuple):
    """A fixture in MJCF.

    Attributes:
      prop: its entity.
      parts: that move.
    """

    prop: Prop
    parts: tuple[Part, ...]


_BOXES: Mapping[type[FixtureDesign], type[Fixture[Any]]] = {
    DrawersDesign: Drawers,
    BaseDoorsDesign: Doors,
    StoveDesign: Stove,
    WallDoorsDesign: Doors,
    WallSlidingDesign: SlidingDoor,
    TallDoorDesign: Doors,
}

_KITCHEN_PROPS: Mapping[type[KitchenPropDesign], type[Prop]] = {
    OvenDesign: props.Oven,
    HoodDesign: props.Hood,
    HingeCabinetDesign: props.HingeCabinet,
    SlideCabinetDesign: props.SlideCabinet,
    MicrowaveDesign: props.Microwave,
}

_KITCHEN_PARTS: Mapping[type[KitchenPropDesign], tuple[Part, ...]] = {
    OvenDesign: _OVEN_PARTS,
    HoodDesign: (_SWITCH,),
    HingeCabinetDesign: (_RIGHT_DOOR,),
    SlideCabinetDesign: (_SLIDING_DOOR,),
    MicrowaveDesign: (_MICROWAVE_DOOR,),
}


def build_fixture(design: FixtureDesign, style: Style, *, visuals: bool, name: str) -> BuiltFixture:
    """Builds the fixture of a design.

    Args:
      design: of the fixture.
      style: colours of the boxes, or of the lacquer of a prop of the kitchen.
      visuals: `False` leaves out the visual geoms; the physics stays the same to the bit.
      name: prefix of its elements in a scene.
    """
    if not isinstance(design, KitchenPropDesign):
        fixture = _BOXES[type(design)](design=design, style=style, visuals=visuals, name=name)
        return BuiltFixture(fixture, fixture.parts)
    prop = _KITCHEN_PROPS[type(design)](visuals=visuals, name=name)
    lacquer = prop.mjcf_model.find("material", "lacquer")
    if lacquer is not None:
        lacquer.rgba = (*style.front, 1)
    return BuiltFixture(prop, _KITCHEN_PARTS[type(design)])

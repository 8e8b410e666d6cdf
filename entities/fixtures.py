"""Parts of fixtures, and the entity of a fixture of boxes: what `fixture_designs` furnishes fixtures with.

`fixture_designs` describes the frame of a fixture. A fixture has parts that move: drawers, doors, knobs, a switch.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import assets
from kitchen_suite.entities.kitchen_styles import DARK, STEEL, Style
from kitchen_suite.entities.props import Prop
from kitchen_suite.types import Vector

PART_KINDS = ("drawer", "door", "sliding door", "knob", "switch", "kettle")  # Kinds of parts.

Handle = Literal["bar", "knob"]

GAP = 0.004  # Gap between fronts, and from a front to the edge of its fixture [m].

PANEL = 0.02  # Thickness of panels [m].
WORKTOP = 0.03  # Thickness of worktops [m].

CLEARANCE = 0.06  # Distance of the axis of a handle's bar from the front [m].
BAR_RADIUS = 0.01  # Radius of a handle's bar [m].
BAR_HALF_LENGTH = 0.06  # Half length of a handle's bar [m].
KNOB_RADIUS = 0.018  # Radius of a knob as a handle [m].

_STIFF_FRICTION = (0.99, 0.999, 0.001)  # `solimpfriction` of slides and hinges, as in `cabinet.Cabinet`.


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


class BoxFixture(Prop):
    """A fixture of boxes, which its design furnishes with boxes and parts.

    Attributes:
      body: that all else is attached to.
      parts: that move, from top to bottom and from left to right.
    """

    parts: tuple[Part, ...] = ()

    def _build(self, *, furnish: Callable[["BoxFixture"], None], style: Style, visuals: bool, name: str) -> None:
        """Builds a fixture in a style; `name` is the prefix of its elements in a scene.

        `furnish` adds the boxes and the parts. Without `visuals` the fixture has no visual geoms; the physics stays the
        same to the bit.
        """
        self._mjcf_root = assets.new_model(name)
        self._add_defaults(style)
        self.body = self._mjcf_root.worldbody.add("body", name="carcass")
        furnish(self)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

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

    def add_geoms(
        self, body: mjcf.Element, name: str, material: str, physical: Mapping[str, Any], **shape: Any
    ) -> None:
        """Adds a colliding geom with physical attributes, and a visual one of the same shape."""
        body.add("geom", name=name, dclass="collision", **physical, **shape)
        body.add("geom", name=f"{name}_visual", dclass="visual", material=material, **shape)

    def add_box(
        self, body: mjcf.Element, name: str, low: Vector, high: Vector, material: str, mass: float = 0.0
    ) -> None:
        """Adds a box between two corners, with a mass [kg]."""
        pos, size = np.add(low, high) / 2, np.subtract(high, low) / 2
        self.add_geoms(body, name, material, {"mass": mass}, type="box", pos=pos, size=size)

    def add_carcass(self, low: Vector, high: Vector) -> None:
        """Adds an open box behind the fronts: sides, floor, top and back."""
        left, front, bottom = low
        right, back, top = high
        front += PANEL
        self.add_box(self.body, "left_side", (left, front, bottom), (left + PANEL, back, top), "carcass")
        self.add_box(self.body, "right_side", (right - PANEL, front, bottom), (right, back, top), "carcass")
        left += PANEL
        right -= PANEL
        self.add_box(self.body, "bottom", (left, front, bottom), (right, back, bottom + PANEL), "carcass")
        self.add_box(self.body, "top", (left, front, top - PANEL), (right, back, top), "carcass")
        self.add_box(self.body, "back", (left, back - PANEL, bottom), (right, back, top), "carcass")

    def add_worktop(self, width: float, depth: float, height: float) -> None:
        """Adds a worktop whose upper face is at a height."""
        low = (-width / 2, -0.01, height - WORKTOP)
        high = (width / 2, depth, height)
        self.add_box(self.body, "worktop", low, high, "worktop")

    def add_part(
        self, kind: str, name: str, opened: float, words: str, *, joint: Mapping[str, Any], **place: Any
    ) -> mjcf.Element:
        """Adds a part whose joint has its name; returns its body, without geoms and handle."""
        body = self.body.add("body", name=name, **place)
        body.add("joint", name=name, solimpfriction=_STIFF_FRICTION, armature=0.01, **joint)
        self.parts = (*self.parts, Part(kind, name, f"{name}_handle", opened, words))
        return body

    def add_handle(self, body: mjcf.Element, kind: Handle, pos: Vector, *, upright: bool) -> None:
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
            self.add_geoms(body, f"{name}_{shape}", "metal", {"friction": (1.0, 0.005, 0.0001)}, **attributes)
        frame = (-1, 0, 0, 0, 0, 1) if upright else (0, 0, 1, 1, 0, 0)
        body.add("site", name=name, pos=(x, y, z), xyaxes=frame, size=(0.008,), group=3)


class BuiltFixture(NamedTuple):
    """A fixture in MJCF.

    Attributes:
      prop: its entity.
      parts: that move.
    """

    prop: Prop
    parts: tuple[Part, ...]

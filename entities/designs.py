"""Designs of generated kitchens: rows of fixtures around the robot, as JSON; the grammar that draws them; their scenes.

Every pair of a split and a number is a kitchen. Designs of different splits have different sequences of fixtures.
"""

import contextlib
import dataclasses
import functools
import numbers
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.entities import fixtures
from kitchen_suite.entities.arms.franka import KITCHEN_FRANKA
from kitchen_suite.entities.assets import Vector
from kitchen_suite.entities.fixtures import KINDS, STYLES, FixtureDesign, Part, Style
from kitchen_suite.entities.parameters import Parameter, door_parameters
from kitchen_suite.entities.props import Kettle, Prop
from kitchen_suite.entities.robot import Robot
from kitchen_suite.entities.scenes import FLOOR, GeneratedKitchenArena, Scene, exclude_base_contacts, robot_base

SPLITS = ("train", "test")

# Sides of the robot, each with the yaw of fixtures that stand there [rad]. The robot faces `back`.
SIDES: Mapping[str, float] = MappingProxyType({"back": 0.0, "left": np.pi / 2, "right": -np.pi / 2})

LEVELS = ("base", "counter", "wall", "tall")  # Levels of rows, which hold fixtures of the same level.
MAX_PARTS = 16  # Greatest number of parts in a kitchen.

_COUNTER_HEIGHT = (1.5, 1.9)  # Bounds of the counter's height [m].
_GAP = (0.0, 1.0)  # Bounds of the gap to the left of a fixture [m].

# Bounds of the numbers of a row in a design [m].
_ROW = {"distance": (0.0, 1.0), "start": (-1.5, 1.5), "height": (1.4, 2.7)}

_DRAWERS_HEIGHT = {1: 0.18, 2: 0.28}  # Least height of drawn drawers with their worktop, by their number [m].

SHOULDER = 0.333  # Height of the arm's shoulder above its base [m], by the lengths of its links.

# Distance from the shoulder to the finger tips with all links in line [m], by the lengths of the links.
REACH = 1.0

_OVERLAP = 0.004  # Depth up to which fixtures may overlap, such as by rounding [m].

# Position of a kettle on the first burner, in the frame of the oven [m].
_KETTLE_PLACE = np.array([-0.169, -0.4, 1.626])

_TOGETHER = ("oven", "hood")  # The hood is part of the oven's back, as in the original kitchen.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """Fixtures side by side, from left to right as seen from the robot.

    Attributes:
      side: key of `SIDES`.
      level: one of `LEVELS`.
      distance: of the fronts from the axis of the robot's base [m].
      start: position of the left end along the row; 0 is before the robot [m].
      height: of the lower edges above the ground, for level `wall` only [m].
      fixtures: of the row.
    """

    side: str
    level: str
    distance: float
    start: float
    height: float | None = None
    fixtures: tuple[FixtureDesign, ...]


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
        return self.position + _turned(self.yaw, *point)


def _turned(yaw: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Returns a point `(3,)` after a rotation about the upright axis [m]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([cos * x - sin * y, sin * x + cos * y, z])


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenDesign:
    """A kitchen.

    Attributes:
      counter_height: of the counters above the ground; the robot's base is at 1.8 [m].
      style: key of `STYLES`.
      kettle: whether a kettle stands on the oven.
      rows: of fixtures.
      name: such as `train/7`; the empty string for a design of one's own.
    """

    counter_height: float
    style: str
    kettle: bool = False
    rows: tuple[Row, ...]
    name: str = ""

    @classmethod
    def make(cls, design: "Design", split: str) -> "KitchenDesign":
        """Returns a checked design.

        Args:
          design: number of a design of the split, from 0; a JSON object, or the path of a file with one; or a design,
            which is checked as well if it has no name.
          split: `train` or `test`.

        Raises:
          TypeError: a value of the wrong type.
          ValueError: a design that cannot be built; messages name the value by its path in the JSON.
        """
        checks.choice(split, SPLITS, "split")
        if isinstance(design, KitchenDesign):
            if design.name:
                return design
            design = design.to_json()
        if isinstance(design, str) and design.isdecimal():
            design = int(design)
        if isinstance(design, Mapping | str | os.PathLike):
            parsed = _parsed(design if isinstance(design, Mapping) else _read(Path(design)))
            _check_reach(parsed)
            return parsed
        return cls.drawn(checks.integer(design, "design", minimum=0), split)

    @staticmethod
    @functools.lru_cache(maxsize=4096)
    def drawn(number: int, split: str) -> "KitchenDesign":
        """Returns the design of a number of a split: the first possible one that the grammar draws from both."""
        generator = np.random.default_rng([SPLITS.index(split), number])
        while True:
            design = _Grammar(generator).design(f"{split}/{number}")
            # A quarter of the sequences of fixtures is for tests.
            if SPLITS[zlib.crc32(design.sequence.encode()) % 4 == 0] != split:
                continue
            kinds = {placed.design.kind for placed in design.placed}
            if kinds & {"oven", "stove"} and kinds - {"oven", "stove", "hood"}:
                with contextlib.suppress(ValueError):
                    design.check()
                    return design

    def to_json(self) -> dict[str, Any]:
        """Returns the design as a JSON object, without what is None."""
        return dataclasses.asdict(self, dict_factory=_json)

    @property
    def sequence(self) -> str:
        """The fixtures by row, without sizes, such as `back base: drawers stove; left tall: tall_door`."""
        rows = (f"{row.side} {row.level}: {' '.join(each.kind for each in row.fixtures)}" for row in self.rows)
        return "; ".join(rows) + ("; kettle" if self.kettle else "")

    @functools.cached_property
    def placed(self) -> tuple[Placed, ...]:
        """The fixtures in their places, row by row."""
        placed, counts = [], dict.fromkeys(KINDS, 0)
        for i, row in enumerate(self.rows):
            along, height = row.start, self.counter_height if row.height is None else row.height
            for j, fixture in enumerate(row.fixtures):
                width = fixture.extent.width
                along += fixture.gap + width / 2
                position = _turned(SIDES[row.side], along, row.distance, height)
                counts[fixture.kind] += 1
                name, path = f"{fixture.kind}_{counts[fixture.kind]}", f"rows[{i}].fixtures[{j}]"
                placed.append(Placed(path, name, fixture, row, np.round(position, 6), SIDES[row.side]))
                along += width / 2
        return tuple(placed)

    def check(self) -> None:
        """Raises a ValueError, with a path in the JSON, unless the kitchen can be built."""
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
            # The pedestal, and room for the arm's base.
            if (low[:2] < 0.16).all() and (high[:2] > -0.16).all() and placed.design.kind != "oven":
                raise ValueError(f"{placed.path} stands where the robot does: increase the distance of its row")
            for other in self.placed[:i]:
                _check_apart(other, placed)


Design = int | str | os.PathLike[str] | Mapping[str, Any] | KitchenDesign
"""A design, the number of one, or its JSON or the path of a file with it; see `KitchenDesign.make`."""


def _json(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Returns fields as a JSON object: without the design's name, what is None, and gaps of 0; tuples are lists."""
    given = [(name, value) for name, value in fields if value is not None and (name, value) != ("gap", 0.0)]
    return {name: [*value] if isinstance(value, tuple) else value for name, value in given if name != "name"}


def _check_apart(one: Placed, other: Placed) -> None:
    """Raises a ValueError if two fixtures overlap."""
    if {one.design.kind, other.design.kind} == {*_TOGETHER}:
        return
    (low, high), (other_low, other_high) = one.bounds, other.bounds
    depths = np.minimum(high, other_high) - np.maximum(low, other_low)
    if (depths > _OVERLAP).all():
        raise ValueError(
            f"{other.path} ({other.design.kind}) overlaps {one.path} ({one.design.kind}) by {depths.min():.3f} m"
        )


def _check_reach(design: KitchenDesign) -> None:
    """Raises a ValueError if the arm is too short for a handle of a design."""
    # An end of a bar may be nearer than its middle.
    shoulder, reach = np.add(robot_base(), (0.0, 0.0, SHOULDER)), REACH + fixtures.BAR_HALF_LENGTH
    for placed in design.placed:
        for name, position in _handles(placed.design):
            distance = np.linalg.norm(placed.in_world(position) - shoulder)
            if distance > reach:
                raise ValueError(
                    f"{placed.path} ({placed.design.kind}) has {name} out of reach: {distance:.2f} m from the "
                    f"robot's shoulder, at most {reach:.2f} m"
                )


@functools.cache
def _handles(design: FixtureDesign) -> tuple[tuple[str | None, NDArray[np.float64]], ...]:
    """Returns each part's joint and the position of its handle in the frame of its fixture [m]."""
    kind = KINDS[design.kind]
    prop = kind.build(design, next(iter(STYLES.values())), False, design.kind)
    physics = mjcf.Physics.from_mjcf_model(prop.mjcf_model)
    sites = [(part.joint, prop.mjcf_model.find("site", part.handle)) for part in kind.parts_of(prop)]
    return tuple((joint, np.add(kind.origin, physics.bind(site).xpos)) for joint, site in sites)


def _read(path: Path) -> Any:
    try:
        return files.load_json(path, "a design")
    except OSError as error:
        problem = f"design must be a number, a JSON object or a file with one: {error}"
        raise ValueError(checks.shortened(problem, 500)) from None


def _parsed(value: object) -> KitchenDesign:
    """Returns the design of a JSON object, checked but for the reach of the arm."""
    fields = _object(value, "design", ("counter_height", "style", "rows"), ("kettle",))
    design = KitchenDesign(
        counter_height=_allowed(fields["counter_height"], "counter_height", _COUNTER_HEIGHT),
        style=checks.choice(fields["style"], STYLES, "style"),
        rows=tuple(_parsed_row(row, path) for row, path in _items(fields["rows"], "rows")),
        kettle=checks.boolean(fields.get("kettle", False), "kettle"),
    )
    design.check()
    return design


def _parsed_row(value: object, path: str) -> Row:
    fields = _object(value, path, ("side", "level", "distance", "start", "fixtures"), ("height",))
    level = checks.choice(fields["level"], LEVELS, f"{path}.level")
    if (level == "wall") != ("height" in fields):
        raise ValueError(f"{path} must have a height if, and only if, its level is 'wall'")
    sizes = {name: _allowed(fields[name], f"{path}.{name}", bounds) for name, bounds in _ROW.items() if name in fields}
    side = checks.choice(fields["side"], SIDES, f"{path}.side")
    fixtures = _items(fields["fixtures"], f"{path}.fixtures")
    return Row(side=side, level=level, fixtures=tuple(_parsed_fixture(*each, level) for each in fixtures), **sizes)


def _parsed_fixture(value: object, path: str, level: str) -> FixtureDesign:
    kinds = [name for name, kind in KINDS.items() if kind.level == level]
    given = _object(value, path, ("kind",), ("width", "height", "count", "handle", "hinge", "gap"))
    kind = checks.choice(given["kind"], kinds, f"{path}.kind of level {level!r}")
    options = dict(KINDS[kind].options)
    if "count" in options and "count" in given and _allowed(given["count"], f"{path}.count", options["count"]) == 2:
        options.pop("hinge", None)
    fields = {"gap": 0.0, **_object(value, path, ("kind", *options), ("gap",))}
    checked = {name: _allowed(fields[name], f"{path}.{name}", each) for name, each in {**options, "gap": _GAP}.items()}
    return FixtureDesign(kind=kind, **checked)


def _object(value: object, path: str, needed: Sequence[str], optional: Sequence[str] = ()) -> Mapping[str, Any]:
    """Returns a JSON object with the needed keys and none but these and optional ones."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{path} must be a JSON object, got {checks.shown(value)}")
    for key in value:
        checks.choice(key, (*needed, *optional), f"key of {path}")
    if missing := [key for key in needed if key not in value]:
        raise ValueError(f"{path} must have {', '.join(missing)}")
    return value


def _items(value: object, path: str) -> list[tuple[object, str]]:
    """Returns the items of a list, each with its path."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"{path} must be a list, got {checks.shown(value)}")
    return [(item, f"{path}[{i}]") for i, item in enumerate(value)]


def _allowed(value: object, path: str, allowed: tuple[Any, ...]) -> Any:
    """Returns a name or an integer from 1 that is among the allowed ones, or a number between two bounds."""
    if isinstance(allowed[0], str):
        return checks.choice(value, allowed, path)
    if isinstance(allowed[0], int):
        return checks.integer(value, path, minimum=1, maximum=max(allowed))
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(f"{path} must be a number, got {checks.shown(value)}")
    if not allowed[0] <= value <= allowed[1]:
        raise ValueError(f"{path} must be between {allowed[0]:g} and {allowed[1]:g}, got {checks.shown(value)}")
    return float(value)


class _Grammar:
    """Draws designs: a wall with an oven below a hood, or one of cabinets, then what stands beside the robot."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._handle = self._choice(fixtures.HANDLES, (0.7, 0.3))

    def design(self, name: str) -> KitchenDesign:
        """Returns a design, which need not be possible."""
        style, has_oven = self._choice(tuple(STYLES)), self._generator.random() < 0.4
        height = self._number(1.58, 1.62) if has_oven else self._number(1.8, 1.86)
        rows = [*(self._oven_wall(height) if has_oven else self._cabinet_wall(height))]
        near = 0.48 if has_oven else rows[0].distance - 0.03
        for side in ("left", "right"):
            rows += self._beside(side, near, 0.0 if has_oven else 0.25)
        kettle = has_oven and self._generator.random() < 0.85
        return KitchenDesign(counter_height=height, style=style, rows=tuple(rows), kettle=kettle, name=name)

    def _oven_wall(self, counter: float) -> Iterator[Row]:
        """Yields the oven, the hood and the cabinets beside and above it, near where the original kitchen has them."""
        x, y = self._number(-0.04, 0.04), self._number(-0.03, 0.02)
        yield _row("back", "base", 0.046 + y, -0.502 + x, FixtureDesign(kind="oven"))
        if self._generator.random() < 0.8:
            yield _row("back", "wall", 0.571 + y, -0.502 + x, FixtureDesign(kind="hood"), height=counter + 0.564)
        yield from self._wall_row(counter + self._number(0.81, 0.84), 0.67 + y, self._number(1.15, 1.3), -0.6 + x)

    def _cabinet_wall(self, counter: float) -> Iterator[Row]:
        """Yields cabinets below a counter, what stands on it, and cabinets above it."""
        distance, width = self._number(0.45, 0.52), self._number(1.1, 1.3)
        start = -width / 2 + self._number(-0.1, 0.1)
        base = self._fixtures(("drawers", "base_doors", "stove"), (0.4, 0.25, 0.35), width, once=("stove",))
        yield _row("back", "base", distance, start, *base)
        if self._generator.random() < 0.35:
            left = self._number(-0.78, -0.66)
            yield _row("back", "counter", distance + 0.05, left, FixtureDesign(kind="microwave"))
        yield from self._wall_row(counter + self._number(0.42, 0.5), distance + self._number(0.03, 0.08), width, start)

    def _wall_row(self, height: float, distance: float, width: float, start: float) -> Iterator[Row]:
        kinds = ("wall_doors", "wall_sliding", "hinge_cabinet", "slide_cabinet")
        fixtures = self._fixtures(kinds, (0.4, 0.2, 0.2, 0.2), width, once=kinds[1:])
        yield _row("back", "wall", distance, start, *fixtures, height=height)

    def _beside(self, side: str, end: float, base: float) -> Iterator[Row]:
        """Yields what stands on a side of the robot, up to a distance before it [m]; nothing, most often.

        `base` is the probability of a base cabinet, whose fronts are out of reach below low counters.
        """
        kind = self._choice(("", "tall", "base"), (0.6 - base, 0.4, base))
        if not kind:
            return
        width, distance = self._number(0.36, 0.42), self._number(0.64, 0.7)
        if kind == "tall":
            fixture = FixtureDesign(kind="tall_door", width=width, handle=self._handle)
        else:
            fixture, end = self._parametric(self._choice(("drawers", "base_doors"), (0.6, 0.4)), width), end - 0.07
            distance -= 0.04
        if fixture.kind != "drawers":
            # A door hinged at the end that is near the robot can be pushed shut.
            fixture = dataclasses.replace(fixture, hinge=side)
        # The right end of a row on the left, and the left end of one on the right, is before the robot.
        start = end - width if side == "left" else -end
        yield _row(side, kind, distance, start, fixture)

    def _fixtures(
        self, kinds: Sequence[str], weights: Sequence[float], width: float, once: Sequence[str]
    ) -> tuple[FixtureDesign, ...]:
        """Returns fixtures side by side that fill a width [m], none of the kinds `once` twice."""
        fixtures: list[FixtureDesign] = []
        while width >= 0.35:
            used = {fixture.kind for fixture in fixtures}.intersection(once)
            allowed = np.where([kind in used for kind in kinds], 0.0, weights)
            kind = self._choice(kinds, allowed / allowed.sum())
            fixture = self._parametric(kind, min(width, self._number(0.35, 0.7)))
            taken = fixture.extent.width
            if fixture.kind == "slide_cabinet" and not fixtures:
                # Its handle, at its left end, would be too far to the left.
                fixture, taken = dataclasses.replace(fixture, gap=0.3), taken + 0.3
            if taken > width + 0.05:
                if np.count_nonzero(allowed) == 1:
                    break
                continue
            fixtures.append(fixture)
            width -= taken
        return tuple(fixtures)

    def _parametric(self, kind: str, width: float) -> FixtureDesign:
        """Returns a fixture of a kind, of a width unless the kind has a fixed one [m]."""
        options = KINDS[kind].options
        if not options:
            return FixtureDesign(kind=kind)
        low, high = options["width"]
        width = round(float(np.clip(width, low, high)), 3)
        sizes: dict[str, Any] = {"width": width} if kind == "stove" else {"width": width, "handle": self._handle}
        match kind:
            case "drawers":
                sizes["count"] = self._choice((1, 2))
                sizes["height"] = round(_DRAWERS_HEIGHT[sizes["count"]] + self._number(0.0, 0.04), 3)
            case "stove":
                sizes["count"], sizes["height"] = self._choice((2, 3, 4)[: int(8 * (width - 0.1)) - 1]), 0.5
            case "wall_sliding":
                sizes["height"], sizes["hinge"] = self._number(0.35, 0.4), self._choice(("left", "right"))
            case _:
                sizes["count"] = 2 if width > 0.55 else 1
                sizes["hinge"] = self._choice(("left", "right")) if sizes["count"] == 1 else None
                sizes["height"] = self._number(0.35, 0.4) if kind == "wall_doors" else self._number(0.4, 0.5)
        return FixtureDesign(kind=kind, **sizes)

    def _number(self, low: float, high: float) -> float:
        return round(float(self._generator.uniform(low, high)), 3)

    def _choice(self, values: Sequence[Any], weights: Any = None) -> Any:
        return values[int(self._generator.choice(len(values), p=weights))]


def _row(
    side: str, level: str, distance: float, start: float, *fixtures: FixtureDesign, height: float | None = None
) -> Row:
    """Returns a row, with its places rounded to millimetres."""
    distance = round(distance, 3)
    start = round(start, 3)
    height = height if height is None else round(height, 3)
    return Row(side=side, level=level, distance=distance, start=start, height=height, fixtures=fixtures)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GeneratedKitchen(Scene):
    """A robot in a generated kitchen.

    Attributes:
      design: of the kitchen.
      parts: the parts that move, each with the name of its prop, in the order of the design.
    """

    design: KitchenDesign
    parts: tuple[tuple[str, Part], ...]

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts, such as `drawers_1/drawer_2`."""
        return tuple(f"{name}/{part.joint or part.handle}" for name, part in self.parts)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of every scene, and factors of damping and of dry friction of all drawers, doors and knobs together."""
        joints = [self.props[name].mjcf_model.find("joint", part.joint) for name, part in self.parts if part.joint]
        return (*super().parameters, *door_parameters("fixtures", joints))


def build_generated_kitchen(design: Design = 0, split: str = "train", *, visuals: bool = True) -> GeneratedKitchen:
    """Builds the kitchen of a design.

    Args:
      design: as of `KitchenDesign.make`.
      split: `train` or `test`, of which the number is.
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    made = KitchenDesign.make(design, split)
    arena = GeneratedKitchenArena(visuals=visuals)
    # The robot first, without its site in the world: all that is of it has the same indices in every kitchen.
    robot, style = Robot(KITCHEN_FRANKA, visuals=visuals), STYLES[made.style]
    arena.attach_at_site(robot)
    arena.mjcf_model.find("site", robot.mjcf_model.model).remove()
    props: dict[str, Prop] = {}
    parts: list[tuple[str, Part]] = []
    for placed in made.placed:
        kind = KINDS[placed.design.kind]
        prop = props[placed.name] = kind.build(placed.design, style, visuals, placed.name)
        arena.attach_at(prop, placed.in_world(np.array(kind.origin)), placed.yaw)
        parts += [(placed.name, part) for part in kind.parts_of(prop)]
    if made.kettle:
        oven = next(each for each in made.placed if each.design.kind == "oven")
        kettle = props["kettle"] = Kettle(visuals=visuals)
        place = oven.in_world(np.array(KINDS["oven"].origin) + _KETTLE_PLACE)
        arena.attach_at(kettle, place, oven.yaw).add("freejoint")
        parts.append(("kettle", fixtures.KETTLE))
    if len(parts) > MAX_PARTS:
        raise ValueError(f"rows must have at most {MAX_PARTS} drawers, doors and knobs, got {len(parts)}")
    if visuals:
        _add_surroundings(arena, made)
    scene = GeneratedKitchen(arena=arena, robot=robot, props=MappingProxyType(props), design=made, parts=tuple(parts))
    exclude_base_contacts(arena, robot)
    return scene


_WALL_REACH = 1.4  # Half the width of the back wall [m].
_WALL_TOP = 3.1  # Height of the walls' upper edges [m].
_WALL = 0.05  # Thickness of the walls [m].
_TILES = 0.5  # Height of the tiles [m].

_PLINTH = 0.1  # Height of plinths [m].
_RECESS = 0.05  # How far plinths stand back [m].

# Of the panel behind the knobs of an oven.
_PANEL_FRONT = 0.64  # Distance from the oven's front [m].
_PANEL_BOTTOM = 0.57  # Height of its lower edge above the counter [m].
_PANEL_TOP = 0.8  # Height of its upper edge above the counter [m].

_TILES_COLOR = (0.94, 0.94, 0.93)


def _add_surroundings(arena: GeneratedKitchenArena, design: KitchenDesign) -> None:
    """Adds what only pictures show: walls, tiles, and boxes between the fixtures and the floor or the wall."""
    style = STYLES[design.style]
    backs = dict.fromkeys(SIDES, 0.0)
    for placed in design.placed:
        depth = placed.design.extent.high[1]
        backs[placed.row.side] = max(backs[placed.row.side], placed.row.distance + depth)
    for placed in design.placed:
        for name, low, high, color in _fillings(placed, backs[placed.row.side], style):
            if (np.subtract(high, low) > 1e-3).all():
                corners = np.sort([placed.in_world(np.array(low)), placed.in_world(np.array(high))], axis=0)
                arena.add_box(f"{placed.name}_{name}", *corners, rgba=(*color, 1))
    paint = {"rgba": (*style.wall, 1)}
    left, right = -max(backs["left"], _WALL_REACH), max(backs["right"], _WALL_REACH)
    back = backs["back"] or _WALL_REACH
    arena.add_box("back_wall", (left, back, FLOOR), (right, back + _WALL, _WALL_TOP), **paint)
    tiles = (left, back - 0.005, design.counter_height), (right, back, design.counter_height + _TILES)
    arena.add_box("tiles", *tiles, rgba=(*_TILES_COLOR, 1))
    for side, inner, outer in (("left", left, left - _WALL), ("right", right, right + _WALL)):
        fronts = [placed.bounds[0][1] for placed in design.placed if placed.row.side == side]
        if fronts:
            low, end = (min(inner, outer), min(fronts) - 0.1, FLOOR), max(back, *fronts) + _WALL
            arena.add_box(f"{side}_wall", low, (max(inner, outer), end, _WALL_TOP), **paint)


def _fillings(placed: Placed, wall: float, style: Style) -> Iterator[tuple[str, Vector, Vector, Vector]]:
    """Yields names, corners in a fixture's frame [m] and colours of the boxes that complete the fixture.

    `wall` is the distance of the wall behind it from the axis of the robot's base [m].
    """
    (left, _, bottom), (right, depth, top) = placed.design.extent
    back, floor = wall - placed.row.distance, FLOOR - placed.position[2]
    if placed.row.level != "counter":
        yield "filling", (left, depth, bottom), (right, back, top), style.carcass
    if placed.design.kind == "oven":
        # Behind the knobs, where the hood is if there is one.
        yield "panel", (left + 0.01, _PANEL_FRONT, _PANEL_BOTTOM), (right - 0.01, back, _PANEL_TOP), fixtures.DARK
    elif placed.row.level in ("base", "tall"):
        plinth = floor + _PLINTH
        yield "plinth", (left, _RECESS, floor), (right, back, min(plinth, bottom)), fixtures.DARK
        yield "lower_carcass", (left, fixtures.PANEL, plinth), (right, back, bottom), style.carcass
        front = fixtures.STEEL if placed.design.kind == "stove" else style.front
        yield "lower_front", (left + fixtures.GAP, 0.0, plinth), (right - fixtures.GAP, fixtures.PANEL, bottom), front

"""Objects in a kitchen, and the places where they may be put: a record beside the kitchen's design.

It is drawn by the design's number.

Designs of kitchens, their JSON and their digests stay as they are, whatever stands on their worktops.
"""

import dataclasses
import zlib
from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args

import msgspec
import numpy as np
from msgspec import Meta

from kitchen_suite import checks
from kitchen_suite.entities.kitchen_designs import REACH, SHOULDER, SPLITS, KitchenDesign
from kitchen_suite.entities.kitchen_plans import fixture_words
from kitchen_suite.entities.places import SURFACES, Place
from kitchen_suite.entities.scenes import robot_base
from kitchen_suite.types import Array, Vector

ObjectKind = Literal["can", "carton", "mug", "bottle"]

OBJECT_KINDS: tuple[ObjectKind, ...] = get_args(ObjectKind)
"""Kinds of objects, in the order in which observations have them."""

_LEAST_OBJECTS = 2  # Least number of objects in a kitchen.
MAX_OBJECTS = 5  # Greatest number of objects in a kitchen.
MAX_PLACES = 8  # Greatest number of places.
TRAY = "tray"

TRAY_HALF_SIZE = (0.15, 0.11)  # Half the width and half the depth of the tray [m].
_TRAY_BASE = 0.006  # Height on which objects stand in the tray [m].
_TRAY_INNER = (0.13, 0.09)  # Half sizes of the box in which the centre of an object is on the tray [m].

_LEAST_REACH, _REACH = 0.34, 0.75  # Horizontal distances from the axis of the robot's base at which objects stand [m].
_WIDEST = 1.75  # Greatest angle from the robot's front at which objects stand [rad].
_TRAY_SHARE = 0.8  # Probability that a tray is looked for a place for.
_APART = 0.13  # Least distance between the middles of objects [m].
_CLEAR = 0.06  # Least distance of the middle of an object from what stands beside it [m].
_KETTLE_ROOM = 0.14  # Half the width of the room that the kettle takes up [m].
_EDGE = 0.06  # Least distance of the middle of an object from the edge of its worktop [m].
_DEPTH = 0.3  # How far from the front of a worktop objects stand [m]: wall cabinets are above what is behind.
_LAYOUTS = 100  # Number of layouts that are drawn until one has room for everything.
_TRIES = 200  # Number of places that are drawn for an object before it is left out.

# Height of the hand above the support, and how far behind the front it is, when it puts something into a place [m].
_HAND_HEIGHT, _HAND_DEPTH = 0.07, 0.08
_UP = np.array([0.0, 0.0, 1.0])

_ARM = 0.9 * REACH  # Distance from the shoulder up to which the hand puts something into a place [m].
_LOWEST = 0.4  # How far below the robot's base the hand puts something down [m].
_ABOVE = 0.001  # Height above the worktop at which objects start, so that nothing is in the worktop [m].


class PlacedObject(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An object in its place at the start.

    Attributes:
      kind: one of `OBJECT_KINDS`.
      position: of the centre of its base in the world [m].
      yaw: about the vertical [rad].
    """

    kind: ObjectKind
    position: tuple[float, float, float]
    yaw: Annotated[float, Meta(ge=-np.pi, le=np.pi)]


class ObjectLayout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Objects in a kitchen, and the places where they may be put.

    Attributes:
      objects: two to five, no kind more than twice.
      tray: pose of the tray as that of an object, x, y and z in the world [m] and yaw [rad]; None without a tray.
      places: names of places, such as `drawers_1/drawer_2`; the tray is a place where there is one.
    """

    objects: Annotated[tuple[PlacedObject, ...], Meta(min_length=_LEAST_OBJECTS, max_length=MAX_OBJECTS)]
    tray: tuple[float, float, float, float] | None = None
    places: Annotated[tuple[str, ...], Meta(min_length=1, max_length=MAX_PLACES)]

    @classmethod
    def make(cls, value: object, design: KitchenDesign) -> "ObjectLayout":
        """Returns a layout of a kitchen, given it or its JSON; for None the one that the number of the design draws.

        Raises a TypeError or a ValueError for a layout that does not fit the kitchen.
        """
        if value is None:
            return cls.drawn(design)
        if not isinstance(value, ObjectLayout):
            try:
                value = msgspec.convert(msgspec.to_builtins(value, str_keys=True), ObjectLayout)
            except (msgspec.ValidationError, RecursionError, TypeError) as error:
                raise ValueError(f"objects are no layout: {error}; got {checks.shown(value)}") from None
        known = [*places_of(design), *([TRAY] if value.tray else [])]
        for place in checks.unique_names(value.places, "places of objects"):
            checks.choice(place, known, "place of objects")
        kinds = [each.kind for each in value.objects]
        if most := [kind for kind in kinds if kinds.count(kind) > 2]:
            raise ValueError(f"objects must have a kind at most twice, got {kinds.count(most[0])} of {most[0]!r}")
        return value

    @classmethod
    def drawn(cls, design: KitchenDesign) -> "ObjectLayout":
        """Returns the layout of a kitchen that its number draws, or its digest where it is a design of one's own."""
        split, _, number = design.name.partition("/")
        seed = [SPLITS.index(split), int(number)] if number else [len(SPLITS), zlib.crc32(msgspec.json.encode(design))]
        generator = np.random.default_rng([*seed, 1])
        for _ in range(_LAYOUTS):
            if (layout := _Drawing(design, generator).layout()) is not None:
                return layout
        raise ValueError("the kitchen has no room for two objects and a place for them: give it objects")

    def to_json(self) -> dict[str, Any]:
        """Returns the layout as a JSON object."""
        value: dict[str, Any] = msgspec.to_builtins(self)
        return value

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects: their kinds, with a number for the second of a kind."""
        kinds = [each.kind for each in self.objects]
        return tuple(kind if kind not in kinds[:number] else f"{kind}_2" for number, kind in enumerate(kinds))

    def places_in(self, design: KitchenDesign) -> tuple[Place, ...]:
        """Returns the places in a kitchen, in the world."""
        known = dict(places_of(design))
        if self.tray is not None:
            x, y, z, yaw = self.tray
            half = _TRAY_INNER if abs(np.sin(yaw)) < 0.5 else _TRAY_INNER[::-1]
            known[TRAY] = Place.around("tray", TRAY, "tray", (x, y, z + _TRAY_BASE), half)
        return tuple(known[name] for name in self.places)


def places_of(design: KitchenDesign) -> Mapping[str, Place]:
    """Returns the places that the fixtures of a kitchen have, in the world, by name."""
    found = {}
    for placed in design.placed:
        fixture = fixture_words(placed, design.placed)
        for place in placed.design.places:
            corners = [placed.in_world(np.array(corner)) for corner in (place.low, place.high)]
            name = f"{placed.name}/{place.name}"
            found[name] = dataclasses.replace(
                place,
                name=name,
                words=f"{place.words} of the {fixture}" if place.words else fixture,
                low=_vector(np.minimum(*corners)),
                high=_vector(np.maximum(*corners)),
                parts=tuple(f"{placed.name}/{part}" for part in place.parts),
            )
    return found


class _Drawing:
    """Draws the layout of a kitchen from a generator."""

    def __init__(self, design: KitchenDesign, generator: np.random.Generator) -> None:
        self._generator = generator
        self._design = design
        self._places = places_of(design)
        self._tops = [place for place in self._places.values() if place.kind == "worktop"]
        # Corners of what may stand on or reach over worktops, seen from above.
        others = [placed for placed in design.placed if placed.row.level in ("counter", "tall")]
        self._taken = [tuple(corner[:2] for corner in placed.bounds) for placed in others]
        self._middles: list[Array] = []

    def layout(self) -> ObjectLayout | None:
        """Returns the layout; None where there is no room for two objects, or for something to put them on."""
        if self._design.kettle:
            # It stands on the front left burner of the oven; the hand does not come to what is behind it.
            x, y, _ = self._places["oven_1/burner_1"].centre
            low, high = (x - 1.0, y - _KETTLE_ROOM), (x + _KETTLE_ROOM, y + 1.0)
            self._taken.append((np.array(low), np.array(high)))
        tray = self._tray() if self._generator.random() < _TRAY_SHARE else None
        kinds = [OBJECT_KINDS[k] for k in self._generator.permutation(len(OBJECT_KINDS))]
        kinds.append(OBJECT_KINDS[int(self._generator.integers(len(OBJECT_KINDS)))])
        count = int(self._generator.integers(_LEAST_OBJECTS, MAX_OBJECTS + 1))
        objects: list[PlacedObject] = []
        for kind in kinds:
            if len(objects) < count and (placed := self._object(kind)) is not None:
                objects.append(placed)
        burners = self._some("burner", 2)
        if len(objects) < _LEAST_OBJECTS or not (tray or burners):
            return None
        containers = self._some("drawer", 2) + self._some("microwave", 1) + self._some("cabinet", 2)
        if not self._tops:
            return None
        nearest = min(self._tops, key=lambda top: float(np.linalg.norm(self._nearest(top))))
        named = [*burners, *containers[: MAX_PLACES - 4], nearest]
        names = [*([TRAY] if tray else []), *(place.name for place in named)]
        return ObjectLayout(objects=tuple(objects), tray=tray, places=tuple(names))

    def _some(self, kind: str, most: int) -> list[Place]:
        """Returns places of a kind within the reach of the hand, in a drawn order."""
        found = [place for place in self._places.values() if place.kind == kind and self._is_reached(place)]
        if kind == "burner":
            found = [place for place in found if self._is_free(place.centre, np.full(2, _CLEAR))]
        order = self._generator.permutation(len(found))
        return [found[k] for k in order[:most]]

    def _is_reached(self, place: Place) -> bool:
        """Returns whether the hand reaches a little way into a place, above its support."""
        shoulder = robot_base() + SHOULDER * _UP
        if place.kind in SURFACES:
            hand = place.centre
        elif place.moves:
            # An open drawer, which comes towards the robot.
            hand = place.centre - self._into(place) * (place.high[1] - place.low[1])
        else:
            hand = self._front(place) + _HAND_DEPTH * self._into(place)
        hand = hand + _HAND_HEIGHT * _UP
        return float(np.linalg.norm(hand - shoulder)) < _ARM and hand[2] > robot_base()[2] - _LOWEST

    def _into(self, place: Place) -> Array:
        """Returns the direction `(3,)` into the fixture of a place."""
        fixture = next(each for each in self._design.placed if each.name == place.name.partition("/")[0])
        return fixture.in_world(np.array([0.0, 1.0, 0.0])) - fixture.position

    def _front(self, place: Place) -> Array:
        """Returns the middle of the front edge of a place's support, `(3,)` [m]."""
        into = self._into(place)
        half = np.subtract(place.high, place.low) / 2
        return place.centre - into * np.abs(into @ half)

    def _nearest(self, top: Place) -> Array:
        """Returns the point of a worktop that is nearest to the robot's axis, seen from above, `(2,)` [m]."""
        return np.clip(np.zeros(2), top.low[:2], top.high[:2])

    def _tray(self) -> tuple[float, float, float, float] | None:
        """Returns the pose of the tray, long side along the front of its worktop; None if there is no room for it."""
        for _ in range(_TRIES):
            top = self._tops[int(self._generator.integers(len(self._tops)))]
            into = self._into(top)
            yaw = float(np.arctan2(-into[0], into[1]))
            half = np.abs([into[1], into[0]]) * TRAY_HALF_SIZE[0] + np.abs([into[0], into[1]]) * TRAY_HALF_SIZE[1]
            middle = self._drawn(top, half)
            if middle is not None and self._is_free(middle, half + 0.01):
                corners = middle[:2] - half, middle[:2] + half
                self._taken.append(corners)
                x, y, z = np.round(middle, 3).tolist()
                return x, y, z, round(yaw, 4)
        return None

    def _object(self, kind: ObjectKind) -> PlacedObject | None:
        """Returns an object of a kind on a worktop, turned so that the hand comes to its grasp; None without room."""
        for _ in range(_TRIES):
            top = self._tops[int(self._generator.integers(len(self._tops)))]
            middle = self._drawn(top, np.full(2, _EDGE))
            turn = float(self._generator.uniform(-0.5, 0.5))
            if middle is None or not self._is_free(middle, np.full(2, _CLEAR)):
                continue
            self._middles.append(middle)
            # The handle of a mug, and an end of a carton, point to the robot.
            yaw = (np.arctan2(-middle[1], -middle[0]) + turn + np.pi) % (2 * np.pi) - np.pi
            x, y, z = np.round(middle, 3).tolist()
            return PlacedObject(kind=kind, position=(x, y, z + _ABOVE), yaw=round(float(yaw), 3))
        return None

    def _drawn(self, top: Place, half: Array) -> Array | None:
        """Returns a point of a worktop, some distance from its edges `(2,)`, near its front and in reach; or None."""
        into = self._into(top)[:2]
        low, high = np.array(top.low[:2]) + half, np.array(top.high[:2]) - half
        x, y = self._generator.uniform(low, np.maximum(low, high))
        middle = np.array([x, y, top.low[2]])
        reach = float(np.linalg.norm(middle[:2]))
        azimuth = abs(np.arctan2(middle[0], middle[1]))
        depth = float((middle - self._front(top))[:2] @ into)
        is_near = _LEAST_REACH < reach < _REACH and azimuth < _WIDEST and depth < _DEPTH
        return middle if is_near and (low <= high).all() else None

    def _is_free(self, middle: Array, half: Array) -> bool:
        """Returns whether nothing else stands within a distance `(2,)` of a point, or near its middle."""
        boxes = ((low - half, high + half) for low, high in self._taken)
        outside = all((middle[:2] < low).any() or (middle[:2] > high).any() for low, high in boxes)
        return outside and all(np.linalg.norm(middle - other) > _APART for other in self._middles)


def _vector(array: Array) -> Vector:
    x, y, z = np.round(array, 6).tolist()
    return x, y, z

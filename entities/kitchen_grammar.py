"""The grammar of generated kitchens: a wall with an oven or one of cabinets, then what stands beside the robot."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.fixture_designs import (
    HANDLES,
    HINGES,
    SLIDING_WIDTH,
    STOVE_WIDTH,
    AnyFixture,
    BaseDoorsDesign,
    DrawersDesign,
    Hinge,
    HingeCabinetDesign,
    HoodDesign,
    Level,
    MicrowaveDesign,
    OvenDesign,
    SlideCabinetDesign,
    StoveDesign,
    TallDoorDesign,
    WallDoorsDesign,
    WallSlidingDesign,
)
from kitchen_suite.entities.fixtures import Handle
from kitchen_suite.entities.kitchen_plans import KitchenPlan, Row, Side
from kitchen_suite.entities.kitchen_styles import STYLES

_LEAST_WIDTH = 0.35  # Width that is left at the end of a row, if it is less [m].
_EXCESS = 0.05  # Width by which fixtures may be wider than their row [m].
_TWO_DOORS_WIDTH = 0.55  # Width above which a cabinet has two doors [m].
_DRAWERS_HEIGHT = {1: 0.18, 2: 0.28}  # Least height of drawers with their worktop, by their number [m].
_STOVE_HEIGHT = 0.5  # Height of stoves [m].

T = TypeVar("T")


def draw_plan(generator: np.random.Generator) -> KitchenPlan:
    """Returns a plan, in which fixtures may overlap."""
    return _Grammar(generator).plan()


class _Grammar:
    """Draws from a generator; the handles of a kitchen are alike."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._handle: Handle = self._choice(HANDLES, (0.7, 0.3))

    def plan(self) -> KitchenPlan:
        style = self._choice(tuple(STYLES))
        has_oven = self._generator.random() < 0.4
        if has_oven:
            height = self._number(1.58, 1.62)
            rows = [*self._oven_wall(height)]
            end = 0.48
            base_probability = 0.0
        else:
            height = self._number(1.8, 1.86)
            rows = [*self._cabinet_wall(height)]
            end = rows[0].distance - 0.03
            base_probability = 0.25
        for side in HINGES:
            rows += self._beside(side, end, base_probability)
        kettle = has_oven and self._generator.random() < 0.85
        return KitchenPlan(counter_height=height, style=style, kettle=kettle, rows=tuple(rows))

    def _oven_wall(self, counter: float) -> Iterator[Row]:
        """Yields the oven, the hood and the cabinets beside and above it, near where the original kitchen has them."""
        x = self._number(-0.04, 0.04)
        y = self._number(-0.03, 0.02)
        yield _row("back", "base", 0.046 + y, -0.502 + x, OvenDesign())
        if self._generator.random() < 0.8:
            yield _row("back", "wall", 0.571 + y, -0.502 + x, HoodDesign(), height=counter + 0.564)
        height = counter + self._number(0.81, 0.84)
        fixtures = self._cabinets(_WALL_KINDS, self._number(1.15, 1.3))
        yield _row("back", "wall", 0.67 + y, -0.6 + x, *fixtures, height=height)

    def _cabinet_wall(self, counter: float) -> Iterator[Row]:
        """Yields cabinets below a counter, what stands on it, and cabinets above it."""
        distance = self._number(0.45, 0.52)
        width = self._number(1.1, 1.3)
        start = -width / 2 + self._number(-0.1, 0.1)
        yield _row("back", "base", distance, start, *self._cabinets(_BASE_KINDS, width))
        if self._generator.random() < 0.35:
            yield _row("back", "counter", distance + 0.05, self._number(-0.78, -0.66), MicrowaveDesign())
        height = counter + self._number(0.42, 0.5)
        distance += self._number(0.03, 0.08)
        yield _row("back", "wall", distance, start, *self._cabinets(_WALL_KINDS, width), height=height)

    def _beside(self, side: Hinge, end: float, base_probability: float) -> Iterator[Row]:
        """Yields what stands on a side of the robot, up to a distance before it [m]; nothing, most often.

        `base_probability` is that of a base cabinet, whose fronts are out of reach below low counters.
        """
        level: Level | None = self._choice((None, "tall", "base"), (0.6 - base_probability, 0.4, base_probability))
        if level is None:
            return
        width = self._number(0.36, 0.42)
        distance = self._number(0.64, 0.7)
        # A door hinged at the end that is near the robot can be pushed shut.
        fixture: AnyFixture
        if level == "tall":
            fixture = TallDoorDesign(width=width, handle=self._handle, hinge=side)
        else:
            kind = self._choice(("drawers", "base_doors"), (0.6, 0.4))
            fixture = _BASE_KINDS[kind].draw(self, width)
            if isinstance(fixture, BaseDoorsDesign):
                fixture = msgspec.structs.replace(fixture, hinge=side)
            end -= 0.07
            distance -= 0.04
        # The right end of a row on the left, and the left end of one on the right, is before the robot.
        start = end - width if side == "left" else -end
        yield _row(side, level, distance, start, fixture)

    def _cabinets(self, kinds: Mapping[str, "_Kind"], width: float) -> tuple[AnyFixture, ...]:
        """Returns fixtures side by side that fill a width [m], of kinds drawn by their weights."""
        fixtures: list[AnyFixture] = []
        while width >= _LEAST_WIDTH:
            present = {fixture.kind for fixture in fixtures}
            used = {name for name, kind in kinds.items() if kind.once and name in present}
            allowed = np.array([0.0 if name in used else kind.weight for name, kind in kinds.items()])
            drawn = self._choice(tuple(kinds.values()), allowed / allowed.sum())
            fixture = drawn.draw(self, min(width, self._number(0.35, 0.7)))
            if isinstance(fixture, SlideCabinetDesign) and not fixtures:
                # Its handle, at its left end, would be too far to the left.
                fixture = SlideCabinetDesign(gap=0.3)
            taken = fixture.extent.width + fixture.gap
            if taken > width + _EXCESS:
                if np.count_nonzero(allowed) == 1:
                    break
                continue
            fixtures.append(fixture)
            width -= taken
        return tuple(fixtures)

    def drawers(self, width: float) -> DrawersDesign:
        count = self._choice((1, 2))
        height = round(_DRAWERS_HEIGHT[count] + self._number(0.0, 0.04), 3)
        return DrawersDesign(width=round(width, 3), height=height, count=count, handle=self._handle)

    def base_doors(self, width: float) -> BaseDoorsDesign:
        count, hinge = self._door_count(width)
        height = self._number(0.4, 0.5)
        return BaseDoorsDesign(width=round(width, 3), height=height, count=count, handle=self._handle, hinge=hinge)

    def stove(self, width: float) -> StoveDesign:
        width = round(max(width, STOVE_WIDTH), 3)
        counts = (2, 3, 4)[: int(8 * (width - 0.1)) - 1]  # Knobs are an eighth of a metre apart at least.
        return StoveDesign(width=width, height=_STOVE_HEIGHT, count=self._choice(counts))

    def wall_doors(self, width: float) -> WallDoorsDesign:
        count, hinge = self._door_count(width)
        height = self._number(0.35, 0.4)
        return WallDoorsDesign(width=round(width, 3), height=height, count=count, handle=self._handle, hinge=hinge)

    def wall_sliding(self, width: float) -> WallSlidingDesign:
        width = round(max(width, SLIDING_WIDTH), 3)
        height = self._number(0.35, 0.4)
        return WallSlidingDesign(width=width, height=height, handle=self._handle, hinge=self._choice(HINGES))

    def _door_count(self, width: float) -> tuple[int, Hinge | None]:
        """Returns the number of doors of a cabinet, and the side of the hinges of a single one."""
        if round(width, 3) > _TWO_DOORS_WIDTH:
            return 2, None
        return 1, self._choice(HINGES)

    def _number(self, low: float, high: float) -> float:
        """Returns a number between two bounds, rounded to thousandths."""
        return round(float(self._generator.uniform(low, high)), 3)

    def _choice(self, values: Sequence[T], weights: Sequence[float] | NDArray[np.float64] | None = None) -> T:
        return values[int(self._generator.choice(len(values), p=weights))]


class _Kind(NamedTuple):
    """A kind of fixture in rows of cabinets.

    Attributes:
      weight: relative probability of the kind.
      draw: draws a fixture of the kind, near a width unless it has one size [m].
      once: whether a row has one at most.
    """

    weight: float
    draw: Callable[[_Grammar, float], AnyFixture]
    once: bool = False


# The kinds in rows of cabinets below a counter and above one, by name.
_BASE_KINDS = {
    "drawers": _Kind(0.4, _Grammar.drawers),
    "base_doors": _Kind(0.25, _Grammar.base_doors),
    "stove": _Kind(0.35, _Grammar.stove, once=True),
}
_WALL_KINDS = {
    "wall_doors": _Kind(0.4, _Grammar.wall_doors),
    "wall_sliding": _Kind(0.2, _Grammar.wall_sliding, once=True),
    "hinge_cabinet": _Kind(0.2, lambda grammar, width: HingeCabinetDesign(), once=True),
    "slide_cabinet": _Kind(0.2, lambda grammar, width: SlideCabinetDesign(), once=True),
}


def _row(
    side: Side, level: Level, distance: float, start: float, *fixtures: AnyFixture, height: float | None = None
) -> Row:
    """Returns a row, with its places rounded to millimetres."""
    return Row(
        side=side,
        level=level,
        distance=round(distance, 3),
        start=round(start, 3),
        height=None if height is None else round(height, 3),
        fixtures=fixtures,
    )

"""Sizes and resistances of a cabinet, and which of them can be built."""

import dataclasses
from collections.abc import Iterator

from kitchen_suite import checks

Vector = tuple[float, float, float]

# Free space about a door, and between a drawer's front and the cabinet's side [m].
DOOR_GAP = 0.003

# Heights, which may be negative.
_SIGNED = ("drawer_heights", "handle_height")

# What sums of sizes may be off by [m].
_ROUNDING = 1e-9


@dataclasses.dataclass(frozen=True, kw_only=True)
class CabinetConfig:
    """Sizes and resistances of a cabinet; the defaults are those that the open_cabinet domain is frozen with.

    The cabinet's frame sits in its middle, x towards the one who opens it, z up. The drawers' frames are the cabinet's
    moved along z.

    Attributes:
      size: depth, width and height, handles not counted [m].
      panel: thickness of every panel [m].
      worktop: thickness of the worktop [m].
      drawer_heights: z of the top and of the bottom drawer's frame [m].
      drawer_front_height: height of a drawer's front [m].
      drawer_travel: how far a drawer opens [m].
      drawer_mass: of a drawer, handle included [kg].
      drawer_friction: dry friction that a drawer's slides hold it with [N].
      drawer_damping: [N s/m].
      door_mass: of a door, handle included [kg].
      door_friction: dry friction of a door's hinge [N m].
      door_damping: [N m s/rad].
      handle_height: z of a handle in its drawer's frame [m].
      handle_clearance: free space between a front and the bar before it [m].
      handle_radius: of the bar [m].
      handle_half_length: of the bar, its round ends not counted [m].
      handle_friction: coefficient of sliding friction; contact takes the greater of the two that meet.
    """

    size: Vector = (0.524, 0.76, 0.8)
    panel: float = 0.02
    worktop: float = 0.03
    drawer_heights: tuple[float, float] = (0.25, 0.05)
    drawer_front_height: float = 0.194
    drawer_travel: float = 0.4
    drawer_mass: float = 2.0
    drawer_friction: float = 3.0
    drawer_damping: float = 15.0
    door_mass: float = 3.0
    door_friction: float = 0.5
    door_damping: float = 1.0
    handle_height: float = 0.01
    handle_clearance: float = 0.035
    handle_radius: float = 0.006
    handle_half_length: float = 0.075
    handle_friction: float = 1.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            _check_field(field.name, getattr(self, field.name), getattr(CabinetConfig, field.name))
        for fits, what in self._requirements():
            if not fits:
                raise ValueError(what)

    @property
    def front(self) -> float:
        """X of the outer face of drawers and doors [m]."""
        return self.size[0] / 2

    @property
    def handle_position(self) -> Vector:
        """Middle of a handle's bar in its drawer's frame [m]."""
        return (self.front + self.handle_clearance + self.handle_radius, 0.0, self.handle_height)

    @property
    def door_span(self) -> tuple[float, float]:
        """Z of the lower and the upper edge of the doors [m]."""
        return 0.06 - self.size[2] / 2, min(self.drawer_heights) - self.drawer_front_height / 2 - 0.006

    def _requirements(self) -> Iterator[tuple[bool, str]]:
        """What must hold between the sizes, and what to say where it does not."""
        (depth, width, height), least = self.size, min(self.size[:2])
        yield (
            4 * self.panel < least,
            f"panel of a cabinet must be less than a quarter of its depth and width {depth, width}, got {self.panel}",
        )
        yield self.worktop < height, f"worktop of a cabinet must be less than its height {height}, got {self.worktop}"
        yield from self._drawer_requirements()
        yield from self._handle_requirements()

    def _drawer_requirements(self) -> Iterator[tuple[bool, str]]:
        top, bottom = self.drawer_heights
        front, highest, (low, high) = self.drawer_front_height, self.size[2] / 2 - self.worktop, self.door_span
        heights = f"drawer_heights of a cabinet {self.drawer_heights} must"
        yield top > bottom, f"{heights} have the top drawer's, the greater one, first"
        yield (
            top - bottom > front - _ROUNDING,
            f"{heights} differ by the drawer_front_height {front} or more: fronts must not overlap",
        )
        yield (
            top + front / 2 < highest + _ROUNDING,
            f"{heights} keep the top drawer's front below the worktop, at {highest:g}",
        )
        yield (
            min(high - low, self.size[1] / 2) > 2 * DOOR_GAP,
            f"size of a cabinet {self.size} must leave room for doors below the drawers at {self.drawer_heights}",
        )

    def _handle_requirements(self) -> Iterator[tuple[bool, str]]:
        half_width, half_height = self.size[1] / 2 - DOOR_GAP, self.drawer_front_height / 2
        yield (
            self.handle_half_length + self.handle_radius < half_width + _ROUNDING,
            f"handle_half_length of a cabinet must keep the bar, its round ends counted, within the front's half width "
            f"{half_width:g}, got {self.handle_half_length}",
        )
        yield (
            abs(self.handle_height) + self.handle_radius < half_height + _ROUNDING,
            f"handle_height of a cabinet must keep the bar within the front's half height {half_height:g}, "
            f"got {self.handle_height}",
        )


def _check_field(name: str, value: object, default: float | tuple[float, ...]) -> None:
    """Refuses what is not built as the default is: a number, or a tuple of as many numbers."""
    what = f"{name} of a cabinet"
    length = len(default) if isinstance(default, tuple) else 0
    if length and not isinstance(value, tuple):
        raise TypeError(f"{what} must be a tuple of {length} numbers, got {value!r}")
    numbers = value if length and isinstance(value, tuple) else (value,)
    if length and len(numbers) != length:
        raise ValueError(f"{what} must hold {length} numbers, got {value!r}")
    for number in numbers:
        if name in _SIGNED:
            checks.vector((number,), 1, what)
        else:
            checks.number(number, what, positive=True)

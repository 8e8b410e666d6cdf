"""Sizes and resistances of a cabinet, and the conditions under which they can be built."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from kitchen_suite import checks
from kitchen_suite.entities.assets import Vector

# Gap around a door, and between a drawer's front and the cabinet's side [m].
DOOR_GAP = 0.003

# Parameters that may be negative.
_SIGNED = ("drawer_heights", "handle_height")

# Least and greatest value of every other parameter, in its unit. MuJoCo's compiler refuses panels of 1e-9 m, bars of
# 1e-8 m and masses of 1e-14 kg, whose inertia it cannot represent; above 1e10 it takes a simulation to have diverged.
_LEAST, _GREATEST = 1e-6, 1e10

# Tolerance for rounding errors in sums of sizes [m].
_ROUNDING = 1e-9


@dataclasses.dataclass(frozen=True, kw_only=True)
class CabinetConfig:
    """Sizes and resistances of a cabinet; the defaults are those that the open_cabinet domain is frozen with.

    The origin of the cabinet's frame is its centre; x points out of its front, z up. A drawer's frame is the cabinet's
    shifted along z.

    Attributes:
      size: depth, width and height, without handles [m].
      panel: thickness of every panel [m].
      worktop: thickness of the worktop [m].
      drawer_heights: z of the frames of the top and the bottom drawer [m].
      drawer_front_height: height of a drawer's front [m].
      drawer_travel: greatest opening of a drawer [m].
      drawer_mass: mass of a drawer with its handle [kg].
      drawer_friction: dry friction of a drawer's slides [N].
      drawer_damping: damping of a drawer's slides [N s/m].
      door_mass: mass of a door with its handle [kg].
      door_friction: dry friction of a door's hinge [N m].
      door_damping: damping of a door's hinge [N m s/rad].
      handle_height: z of a handle in its drawer's frame [m].
      handle_clearance: gap between a front and the bar of its handle [m].
      handle_radius: radius of the bar [m].
      handle_half_length: half length of the bar without its round ends [m].
      handle_friction: coefficient of sliding friction; a contact has the greater one of the two geoms' coefficients.
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
        for name, is_met, requirement in self._requirements():
            if not is_met:
                raise ValueError(f"{name} of a cabinet must {requirement}, got {getattr(self, name)}")

    @property
    def front(self) -> float:
        """X of the outer face of drawers and doors [m]."""
        return self.size[0] / 2

    @property
    def handle_position(self) -> Vector:
        """Centre of a handle's bar in its drawer's frame [m]."""
        return (self.front + self.handle_clearance + self.handle_radius, 0.0, self.handle_height)

    @property
    def door_span(self) -> tuple[float, float]:
        """Z of the lower and the upper edge of the doors [m]."""
        return 0.06 - self.size[2] / 2, min(self.drawer_heights) - self.drawer_front_height / 2 - 0.006

    def _requirements(self) -> Iterator[tuple[str, bool, str]]:
        """Yields parameter, whether its requirement is met, and the requirement, for all relations between sizes."""
        (depth, width, height), (top, bottom), front = self.size, self.drawer_heights, self.drawer_front_height
        low, high = self.door_span
        worktop_z, half_width = height / 2 - self.worktop, width / 2 - DOOR_GAP
        yield "panel", 4 * self.panel < min(depth, width), f"be less than a quarter of depth {depth} and width {width}"
        yield "worktop", self.worktop < height, f"be less than its height {height}"
        yield "drawer_heights", top > bottom, "begin with the top drawer's, the greater one"
        yield "drawer_heights", top - bottom > front - _ROUNDING, f"differ by the drawer_front_height {front} or more"
        below = f"keep the top drawer's front below the worktop, at {worktop_z:g}"
        yield "drawer_heights", top + front / 2 < worktop_z + _ROUNDING, below
        has_doors = min(high - low, width / 2) > 2 * DOOR_GAP
        yield "size", has_doors, f"leave room for doors below the drawers at {self.drawer_heights}"
        end = self.handle_half_length + self.handle_radius
        yield "handle_half_length", end < half_width + _ROUNDING, f"keep the bar within the half width {half_width:g}"
        edge = abs(self.handle_height) + self.handle_radius
        yield "handle_height", edge < front / 2 + _ROUNDING, f"keep the bar within the half height {front / 2:g}"


def _check_field(name: str, value: Any, default: float | tuple[float, ...]) -> None:
    """Raises an error unless a value is like the default: a number, or a tuple of as many numbers."""
    what = f"{name} of a cabinet"
    numbers = (value,)
    if isinstance(default, tuple):
        if not isinstance(value, tuple):
            raise TypeError(f"{what} must be a tuple of {len(default)} numbers, got {value!r}")
        if len(value) != len(default):
            raise ValueError(f"{what} must hold {len(default)} numbers, got {value!r}")
        numbers = value
    for number in numbers:
        if name in _SIGNED:
            checks.vector((number,), 1, what)
        else:
            if not _LEAST <= checks.number(number, what, positive=True) <= _GREATEST:
                raise ValueError(f"{what} must be between {_LEAST:g} and {_GREATEST:g}, got {value!r}")

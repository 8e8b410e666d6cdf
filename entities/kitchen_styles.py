"""Styles of generated kitchens: colours, red, green and blue from 0 to 1."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from kitchen_suite.types import Vector

StyleName = Literal["slate", "oak", "white", "sage", "navy", "terracotta"]

# Colours that do not depend on the style.
DARK = (0.12, 0.12, 0.13)  # Of windows, cooktops and plinths.
STEEL = (0.72, 0.73, 0.75)  # Of stoves.
TILES = (0.94, 0.94, 0.93)  # Of the tiles above the counter.


class Style(NamedTuple):
    """Colours of a kitchen.

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


STYLES: Mapping[StyleName, Style] = MappingProxyType(
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

"""Variations of appearance and cameras that the domains share: colours, lights, views.

Seen colours are pale or muted, those held out stronger or darker. Held-out textures are of other kinds than seen ones.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from kitchen_suite.entities.appearance import FRANKA, camera_prefix
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, between, one_of
from kitchen_suite.types import Vector

APPEARANCE = "appearance"
CAMERA = "camera"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Palette:
    """Colours of a kind of surface: red, green and blue from 0 to 1.

    Attributes:
      seen: for training.
      held_out: for evaluation.
    """

    seen: Sequence[Vector]
    held_out: Sequence[Vector]


PAINT = Palette(
    seen=(
        (0.92, 0.91, 0.88),
        (0.93, 0.88, 0.76),
        (0.75, 0.76, 0.78),
        (0.82, 0.80, 0.76),
        (0.72, 0.77, 0.68),
        (0.82, 0.75, 0.66),
        (0.70, 0.66, 0.60),
    ),
    held_out=(
        (0.76, 0.52, 0.42),
        (0.84, 0.70, 0.42),
        (0.42, 0.62, 0.62),
        (0.46, 0.58, 0.46),
        (0.42, 0.50, 0.65),
        (0.72, 0.50, 0.52),
    ),
)

LACQUER = Palette(
    seen=(
        (0.46, 0.50, 0.60),
        (0.90, 0.90, 0.88),
        (0.88, 0.82, 0.70),
        (0.60, 0.61, 0.63),
        (0.55, 0.63, 0.53),
        (0.58, 0.52, 0.46),
        (0.85, 0.70, 0.52),
        (0.36, 0.47, 0.53),
    ),
    held_out=(
        (0.26, 0.34, 0.52),
        (0.26, 0.43, 0.34),
        (0.55, 0.26, 0.27),
        (0.80, 0.65, 0.34),
        (0.72, 0.46, 0.35),
        (0.33, 0.34, 0.36),
    ),
)

# Multiply stone, wood and metal.
TINT = Palette(
    seen=((1.0, 1.0, 1.0), (0.95, 0.90, 0.82), (0.80, 0.82, 0.85), (0.85, 0.80, 0.75), (0.90, 0.95, 0.92)),
    held_out=((0.72, 0.62, 0.52), (0.58, 0.64, 0.70), (0.80, 0.66, 0.54), (0.62, 0.62, 0.64)),
)
METAL = Palette(
    seen=((1.0, 1.0, 1.0), (0.88, 0.89, 0.92), (1.0, 0.96, 0.90)),
    held_out=((1.00, 0.86, 0.58), (1.00, 0.78, 0.66), (0.70, 0.62, 0.54)),
)

APPLIANCE = Palette(
    seen=((0.20, 0.20, 0.20), (0.15, 0.15, 0.16), (0.33, 0.34, 0.36), (0.24, 0.22, 0.20)),
    held_out=((0.85, 0.85, 0.83), (0.50, 0.22, 0.21), (0.60, 0.70, 0.65), (0.27, 0.33, 0.46), (0.60, 0.60, 0.61)),
)
HOB = Palette(
    seen=((0.15, 0.15, 0.15), (0.20, 0.20, 0.21), (0.27, 0.27, 0.28), (0.20, 0.18, 0.17)),
    held_out=((0.62, 0.62, 0.63), (0.80, 0.80, 0.78), (0.42, 0.40, 0.38), (0.20, 0.24, 0.32)),
)
KETTLE = Palette(
    seen=((0.90, 0.90, 0.90), (0.90, 0.86, 0.76), (0.74, 0.75, 0.77), (0.68, 0.76, 0.82)),
    held_out=((0.70, 0.18, 0.16), (0.85, 0.68, 0.26), (0.25, 0.42, 0.36), (0.24, 0.24, 0.25)),
)
ROBOT = Palette(
    seen=(FRANKA.color, (0.92, 0.92, 0.93), (0.98, 0.95, 0.90)),
    held_out=((0.40, 0.41, 0.44), (0.86, 0.74, 0.56), (0.62, 0.70, 0.80)),
)
GREY = Palette(
    seen=((0.50, 0.50, 0.50), (0.55, 0.56, 0.58), (0.66, 0.66, 0.66), (0.42, 0.42, 0.44)),
    held_out=((0.86, 0.86, 0.85), (0.28, 0.28, 0.30), (0.50, 0.42, 0.34)),
)


def color(surface: str, palette: Palette) -> ParameterVariation:
    """Returns the variation of a surface's colour; `surface` is the beginning of its name, such as `walls/`."""
    # Each colour in three shades.
    seen, held_out = (
        [np.multiply(rgb, shade) for rgb in colors for shade in (0.8, 0.9, 1.0)]
        for colors in (palette.seen, palette.held_out)
    )
    return one_of(f"{surface}color", APPEARANCE, seen=seen, held_out=held_out)


def texture(surface: str, *, seen: Sequence[int], held_out: Sequence[int]) -> ParameterVariation:
    """Returns the variation of a surface's texture, by numbers; 0 is that of the built scene."""
    return one_of(f"{surface}texture", APPEARANCE, seen=seen, held_out=held_out)


def brightness(
    light: str,
    *,
    seen: tuple[float, float] = (0.8, 1.2),
    held_out: Sequence[tuple[float, float]] = ((0.6, 0.8), (1.2, 1.4)),
) -> ParameterVariation:
    """Returns the variation of the brightness of lights; `light` is the beginning of the parameter's name."""
    return between(f"{light}brightness", APPEARANCE, seen=seen, held_out=held_out)


# Variations of the floor, the robot, the lights and the walls, in all domains.
ROOM = (
    color("floor/", TINT),
    texture("floor/", seen=(0, 1, 2), held_out=(3, 4)),
    color("franka/", ROBOT),
    brightness("light/"),
    around("light/warmth", APPEARANCE, seen=0.07, held_out=0.14),
    between("light/ambient", APPEARANCE, seen=(0.0, 0.06), held_out=((0.06, 0.12),)),
    around("light/rotation", APPEARANCE, seen=(0.08, 0.08, 0.3), held_out=(0.16, 0.16, 0.6)),
    color("walls/", PAINT),
    texture("walls/", seen=(0, 1, 2), held_out=(3, 4)),
)

# Variations in all domains with a microwave.
MICROWAVE = (color("microwave/", APPLIANCE), color("microwave/handle_", METAL))


def cameras(*names: str) -> tuple[ParameterVariation, ...]:
    """Returns the variations of cameras, given their full names; those on the robot's hand are displaced less."""
    variations: list[ParameterVariation] = []
    for name in names:
        prefix, offset = camera_prefix(name), 0.005 if "/" in name else 0.05
        variations += [
            around(f"{prefix}offset", CAMERA, seen=offset, held_out=2 * offset),
            around(f"{prefix}rotation", CAMERA, seen=0.03, held_out=0.06),
            around(f"{prefix}fovy", CAMERA, seen=2.0, held_out=4.0),
        ]
    return tuple(variations)

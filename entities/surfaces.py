"""The surfaces of the arenas' scenes, and the textures that they may have.

Pictures come with gymnasium-robotics; other textures are those that MuJoCo builds in.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite.entities.appearance import Surface, Texture
from kitchen_suite.entities.robots import franka

_FOLDER = "kitchen_assets/textures"

# Materials of fronts and worktops, and of walls.
_SATIN: Mapping[str, Any] = MappingProxyType({"specular": 0.2, "shininess": 0.3})
_MATT: Mapping[str, Any] = MappingProxyType({"specular": 0.0, "shininess": 0.0})


def _picture(name: str, file: str, **material: Any) -> Texture:
    return Texture(name=name, texture={"file": f"{_FOLDER}/{file}.png"}, material=material)


def _speckles(name: str, share: float, shade: float, **material: Any) -> Texture:
    """Returns white with a share of darker pixels."""
    texture = {
        "builtin": "flat",
        "width": 256,
        "height": 256,
        "rgb1": (1, 1, 1),
        "rgb2": (1, 1, 1),
        "mark": "random",
        "markrgb": (shade, shade, shade),
        "random": share,
    }
    return Texture(name=name, texture=texture, material=material)


def _plain(name: str, **material: Any) -> Texture:
    texture = {"builtin": "flat", "width": 8, "height": 8, "rgb1": (1, 1, 1), "rgb2": (1, 1, 1)}
    return Texture(name=name, texture=texture, material=material)


def _checks(name: str, shade: float, **material: Any) -> Texture:
    texture = {"builtin": "checker", "width": 128, "height": 128, "rgb1": (1, 1, 1), "rgb2": (shade, shade, shade)}
    return Texture(name=name, texture=texture, material=material)


def _per_metre(repeats: float, **material: Any) -> dict[str, Any]:
    return {"texrepeat": (repeats, repeats), "texuniform": True, **material}


_FLOOR = Surface(
    prefix="floor/",
    color=(1, 1, 1),
    materials=("tiles",),
    kind="2d",
    textures=(
        _picture("wood", "wood1", **_per_metre(1)),
        _picture("grouted_tiles", "white_marble_tile", **_per_metre(1.25)),
        _checks("checks", 0.7, **_per_metre(1.5)),
        _picture("concrete", "metal1", **_per_metre(0.5)),
    ),
)
_FRANKA = Surface(
    prefix="franka/",
    color=franka.COLOR,
    geoms=tuple(
        f"franka/{part}_visual" for part in (*(f"link{i}" for i in range(8)), "hand", "left_finger", "right_finger")
    ),
    shades={f"franka/{part}_visual": shade for part, shade in franka.SHADES.items()},
)
_MICROWAVE = (
    Surface(prefix="microwave/", color=(0.2, 0.2, 0.2), materials=("microwave/plastic",)),
    Surface(prefix="microwave/handle_", color=(1, 1, 1), materials=("microwave/metal",)),
)
_WALL_TEXTURES = (
    _speckles("plaster", 0.3, 0.93, **_MATT),
    _picture("concrete", "metal1", **_MATT),
    _picture("marble", "marble1", **_MATT),
    _picture("mosaic", "tile1", **_MATT),
)
_FRONT_TEXTURES = (
    _picture("wood", "wood1", **_SATIN),
    _picture("concrete", "metal1", **_SATIN),
    _speckles("laminate", 0.2, 0.85, **_SATIN),
    _picture("marble", "marble1", **_SATIN),
)

KITCHEN = (
    _FLOOR,
    Surface(prefix="walls/", color=(0.82, 0.8, 0.76), materials=("walls/paint",), textures=_WALL_TEXTURES),
    Surface(prefix="walls/base_board_", color=(0.9, 0.9, 0.9), materials=("walls/base_board",)),
    Surface(
        prefix="counter/",
        color=(1, 1, 1),
        materials=("counter/marble",),
        textures=(
            _picture("wood", "wood1", specular=0.2, shininess=0.3),
            _speckles("granite", 0.3, 0.7, specular=0.4, shininess=0.6),
            _picture("concrete", "metal1", specular=0.1, shininess=0.2),
            _picture("mosaic", "tile1", specular=0.3, shininess=0.5),
        ),
    ),
    Surface(
        prefix="cabinets/",
        color=(0.46, 0.5, 0.6),
        materials=("counter/lacquer", "slide_cabinet/lacquer", "hinge_cabinet/lacquer"),
        textures=_FRONT_TEXTURES,
    ),
    Surface(
        prefix="handles/", color=(1, 1, 1), materials=("counter/metal", "slide_cabinet/metal", "hinge_cabinet/metal")
    ),
    Surface(prefix="oven/metal_", color=(1, 1, 1), materials=("oven/metal", "hood/metal")),
    Surface(prefix="oven/enamel_", color=(0.15, 0.15, 0.15), materials=("oven/enamel", "hood/enamel")),
    *_MICROWAVE,
    Surface(prefix="kettle/", color=(0.9, 0.9, 0.9), materials=("kettle/enamel",)),
    Surface(
        prefix="kettle/grip_",
        color=(1, 1, 1),
        materials=("kettle/wood",),
        textures=(
            _plain("plastic", specular=0.5, shininess=0.5),
            _picture("metal", "metal1", specular=0.8, shininess=0.8),
            _speckles("cork", 0.4, 0.6, specular=0.1, shininess=0.1),
        ),
    ),
    Surface(prefix="pedestal/", color=(0.5, 0.5, 0.5), geoms=("pedestal",)),
    _FRANKA,
)

_ROOM = (
    _FLOOR,
    # The wall is metres wide, over which the sides of a cube would be stretched; a flat texture becomes stripes on it.
    Surface(
        prefix="walls/",
        color=(0.88, 0.86, 0.82),
        materials=("wall",),
        kind="2d",
        textures=(
            _checks("wallpaper", 0.93, **_per_metre(2, **_MATT)),
            _picture("concrete", "metal1", **_per_metre(0.5, **_MATT)),
            _picture("panelling", "wood1", **_per_metre(0.5, **_MATT)),
            _picture("marble", "marble1", **_per_metre(0.5, **_MATT)),
        ),
    ),
)

OPEN_CABINET = (
    *_ROOM,
    Surface(prefix="cabinet/front_", color=(0.36, 0.47, 0.53), materials=("cabinet/front",), textures=_FRONT_TEXTURES),
    Surface(prefix="cabinet/carcass_", color=(0.80, 0.79, 0.76), materials=("cabinet/carcass",)),
    Surface(prefix="cabinet/tray_", color=(0.72, 0.58, 0.42), materials=("cabinet/tray",)),
    Surface(
        prefix="cabinet/worktop_",
        color=(1, 1, 1),
        materials=("cabinet/worktop",),
        textures=(
            _picture("marble", "marble1", **_SATIN),
            _speckles("granite", 0.3, 0.7, **_SATIN),
            _picture("concrete", "metal1", **_SATIN),
        ),
    ),
    Surface(prefix="cabinet/handle_", color=(0.80, 0.80, 0.82), materials=("cabinet/metal",)),
    _FRANKA,
)

MICROWAVE_TABLE = (
    *_ROOM,
    Surface(
        prefix="table/",
        color=(1, 1, 1),
        materials=("wood",),
        textures=(
            _picture("marble", "marble1", **_SATIN),
            _speckles("laminate", 0.2, 0.85, **_SATIN),
            _picture("concrete", "metal1", **_SATIN),
        ),
    ),
    Surface(prefix="table/leg_", color=(0.36, 0.47, 0.53), materials=("leg",)),
    Surface(prefix="pedestal/", color=(0.55, 0.56, 0.58), materials=("steel",)),
    *_MICROWAVE,
    _FRANKA,
)

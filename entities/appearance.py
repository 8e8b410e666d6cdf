"""Appearance of scenes: surfaces, lights and cameras, whose parameters only images depend on.

A renderer copies textures when it is made, so a texture is changed by giving geoms another material. `add_variants`
adds these materials to a scene before it is compiled. Parameters are written to a model that has its built values, to
which offsets, rotations and factors are relative.
"""

import collections
import dataclasses
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.entities import cabinet
from kitchen_suite.entities.parameters import Elements, Parameter, ParameterType, shared_value
from kitchen_suite.types import Vector

_MATERIAL = mujoco.mjtObj.mjOBJ_MATERIAL
_GEOM = mujoco.mjtObj.mjOBJ_GEOM

_FOLDER = "kitchen_assets/textures"

# Materials of fronts and worktops, and of walls.
_SATIN: Mapping[str, Any] = MappingProxyType({"specular": 0.2, "shininess": 0.3})
_MATT: Mapping[str, Any] = MappingProxyType({"specular": 0.0, "shininess": 0.0})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Texture:
    """A texture that a surface may have instead of its own.

    Attributes:
      name: within its surface.
      texture: MJCF attributes of the texture beside its name and type.
      material: MJCF attributes of the material beside its name, texture and colour.
    """

    name: str
    texture: Mapping[str, Any]
    material: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Surface:
    """Parts of a scene that have one colour, and perhaps several textures to choose from.

    Attributes:
      prefix: of the names of its parameters, such as `walls/`.
      color: red, green and blue as built, from 0 to 1; the texture is multiplied by it.
      materials: full names of its materials.
      geoms: full names of its geoms without material.
      shades: factors of the colour, by full name, of those geoms that are darker than others.
      kind: type of its textures, `cube` or `2d`.
      textures: to choose from, beside that of the materials.
    """

    prefix: str
    color: Vector
    materials: Sequence[str] = ()
    geoms: Sequence[str] = ()
    shades: Mapping[str, float] = dataclasses.field(default_factory=dict)
    kind: str = "cube"
    textures: Sequence[Texture] = ()

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the materials of `textures`."""
        stem = self.prefix.replace("/", "_")
        return tuple(f"{stem}{texture.name}" for texture in self.textures)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Colour; number of the texture, 0 for that of the built scene, if there are several."""
        color = Parameter(name=f"{self.prefix}color", unit="1", type=_color(self), elements=())
        if not self.textures:
            return (color,)
        return color, Parameter(name=f"{self.prefix}texture", unit="1", type=_texture(self), elements=())


def add_variants(root: mjcf.RootElement, surfaces: Iterable[Surface]) -> None:
    """Adds the materials of the textures to choose from, for those surfaces that the scene shows.

    The model with all that is attached to its `root` is not yet compiled. Physics and images stay the same to the bit
    while no parameter is set.
    """
    materials = {material.full_identifier for material in root.find_all("material")}
    loaded = {_source(texture): texture for texture in root.find_all("texture") if texture.file is not None}
    for surface in surfaces:
        if materials.isdisjoint(surface.materials):
            continue
        for name, texture in zip(surface.variants, surface.textures, strict=True):
            element = root.asset.add("texture", name=name, type=surface.kind, **texture.texture)
            # A renderer takes long to load large textures: of equal ones from a file, one is enough.
            if element.file is not None and (first := loaded.setdefault(_source(element), element)) is not element:
                element.remove()
                element = first
            root.asset.add("material", name=name, texture=element, rgba=(*surface.color, 1), **texture.material)


def _source(texture: mjcf.Element) -> tuple[str, str]:
    """Returns type and file, named by its contents."""
    return texture.type, texture.file.get_vfs_filename()


class _Ids:
    """Numbers of named elements in compiled scenes; each scene is searched once."""

    def __init__(self, kind: mujoco.mjtObj, names: Sequence[str]) -> None:
        self._kind, self._names = kind, names
        self._found: weakref.WeakKeyDictionary[mujoco.MjModel, NDArray[np.int64]] = weakref.WeakKeyDictionary()

    def __call__(self, physics: mjcf.Physics) -> NDArray[np.int64]:
        """Returns the numbers of those elements that a scene has."""
        model = physics.model.ptr
        found = self._found.get(model)
        if found is None:
            numbers = [mujoco.mj_name2id(model, self._kind, name) for name in self._names]
            found = self._found[model] = np.array([number for number in numbers if number >= 0], np.int64)
        return found


def _color(surface: Surface) -> ParameterType:
    names = (*surface.materials, *surface.variants)
    materials = _Ids(_MATERIAL, names)
    geom_names: dict[float, list[str]] = collections.defaultdict(list)
    for name in surface.geoms:
        geom_names[surface.shades.get(name, 1.0)].append(name)
    by_shade = {shade: _Ids(_GEOM, group) for shade, group in geom_names.items()}

    def arrays(physics: mjcf.Physics) -> Iterator[tuple[NDArray, NDArray[np.int64], float]]:
        model = physics.model.ptr
        yield model.mat_rgba, materials(physics), 1.0
        for shade, geoms in by_shade.items():
            yield model.geom_rgba, geoms(physics), shade

    def read(physics: mjcf.Physics, elements: Elements) -> ArrayLike:
        for rgba, ids, shade in arrays(physics):
            if ids.size:
                present = rgba[ids[0], :3]
                # The model has single precision. The built colour is the surface's own, as without visuals.
                is_built = np.array_equal(present, np.multiply(shade, surface.color).astype(present.dtype))
                return surface.color if is_built else present / shade
        return surface.color

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        for rgba, ids, shade in arrays(physics):
            if ids.size:
                rgba[ids, :3] = shade * value

    fields = (*(["mat_rgba"] if names else []), *(["geom_rgba"] if surface.geoms else []))
    return ParameterType(read=read, write=write, model_fields=fields, shape=(3,), non_negative=True, visual=True)


def _texture(surface: Surface) -> ParameterType:
    own, variants = _Ids(_MATERIAL, surface.materials), _Ids(_MATERIAL, surface.variants)

    def read(physics: mjcf.Physics, elements: Elements) -> ArrayLike:
        shown = enumerate(variants(physics), start=1)
        return max((i for i, number in shown if number in physics.model.ptr.geom_matid), default=0)

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        if value and (numbers := variants(physics)).size:
            matid = physics.model.ptr.geom_matid
            matid[np.isin(matid, own(physics))] = numbers[int(value) - 1]

    return ParameterType(
        read=read, write=write, model_fields=("geom_matid",), visual=True, choices=1 + len(surface.textures)
    )


def _image_texture(name: str, file: str, **material: Any) -> Texture:
    return Texture(name=name, texture={"file": f"{_FOLDER}/{file}.png"}, material=material)


def _speckles(name: str, share: float, shade: float, **material: Any) -> Texture:
    """Returns white with a share of darker pixels."""
    speckles = {"mark": "random", "markrgb": (shade, shade, shade), "random": share}
    return Texture(name=name, texture={**_white(256), **speckles}, material=material)


def _checks(name: str, shade: float, **material: Any) -> Texture:
    """Returns white with darker squares."""
    checks = {"builtin": "checker", "rgb2": (shade, shade, shade)}
    return Texture(name=name, texture={**_white(128), **checks}, material=material)


def _white(size: int) -> dict[str, Any]:
    return {"builtin": "flat", "width": size, "height": size, "rgb1": (1, 1, 1), "rgb2": (1, 1, 1)}


def _per_metre(repeats: float, **material: Any) -> dict[str, Any]:
    return {"texrepeat": (repeats, repeats), "texuniform": True, **material}


_FLOOR = Surface(
    prefix="floor/",
    color=(1, 1, 1),
    materials=("tiles",),
    kind="2d",
    textures=(
        _image_texture("wood", "wood1", **_per_metre(1)),
        _image_texture("grouted_tiles", "white_marble_tile", **_per_metre(1.25)),
        _checks("checks", 0.7, **_per_metre(1.5)),
        _image_texture("concrete", "metal1", **_per_metre(0.5)),
    ),
)
# Surfaces that arenas share: of the robot, of the microwave, and of a room of floor and walls.
FRANKA = Surface(
    prefix="franka/",
    color=(0.94, 0.935, 0.92),
    geoms=tuple(
        f"franka/{part}_visual" for part in (*(f"link{i}" for i in range(8)), "hand", "left_finger", "right_finger")
    ),
    # Of the class `visual_dark`. With powers of two, products are exact.
    shades={f"franka/{part}_visual": 0.5 for part in ("link7", "hand", "left_finger", "right_finger")},
)
MICROWAVE = (
    Surface(prefix="microwave/", color=(0.2, 0.2, 0.2), materials=("microwave/plastic",)),
    Surface(prefix="microwave/handle_", color=(1, 1, 1), materials=("microwave/metal",)),
)
_WALL_TEXTURES = (
    _speckles("plaster", 0.3, 0.93, **_MATT),
    _image_texture("concrete", "metal1", **_MATT),
    _image_texture("marble", "marble1", **_MATT),
    _image_texture("mosaic", "tile1", **_MATT),
)
_CONCRETE = _image_texture("concrete", "metal1", **_SATIN)
_MARBLE = _image_texture("marble", "marble1", **_SATIN)
_LAMINATE = _speckles("laminate", 0.2, 0.85, **_SATIN)
_FRONT_TEXTURES = (_image_texture("wood", "wood1", **_SATIN), _CONCRETE, _LAMINATE, _MARBLE)

KITCHEN = (
    _FLOOR,
    Surface(prefix="walls/", color=(0.82, 0.8, 0.76), materials=("walls/paint",), textures=_WALL_TEXTURES),
    Surface(prefix="walls/base_board_", color=(0.9, 0.9, 0.9), materials=("walls/base_board",)),
    Surface(
        prefix="counter/",
        color=(1, 1, 1),
        materials=("counter/marble",),
        textures=(
            _image_texture("wood", "wood1", **_SATIN),
            _speckles("granite", 0.3, 0.7, specular=0.4, shininess=0.6),
            _image_texture("concrete", "metal1", specular=0.1, shininess=0.2),
            _image_texture("mosaic", "tile1", specular=0.3, shininess=0.5),
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
    *MICROWAVE,
    Surface(prefix="kettle/", color=(0.9, 0.9, 0.9), materials=("kettle/enamel",)),
    Surface(
        prefix="kettle/grip_",
        color=(1, 1, 1),
        materials=("kettle/wood",),
        textures=(
            Texture(name="plastic", texture=_white(8), material={"specular": 0.5, "shininess": 0.5}),
            _image_texture("metal", "metal1", specular=0.8, shininess=0.8),
            _speckles("cork", 0.4, 0.6, specular=0.1, shininess=0.1),
        ),
    ),
    Surface(prefix="pedestal/", color=(0.5, 0.5, 0.5), geoms=("pedestal",)),
    FRANKA,
)

ROOM = (
    _FLOOR,
    # The wall is metres wide, over which the sides of a cube would be stretched; a flat texture becomes stripes on it.
    Surface(
        prefix="walls/",
        color=(0.88, 0.86, 0.82),
        materials=("wall",),
        kind="2d",
        textures=(
            _checks("wallpaper", 0.93, **_per_metre(2, **_MATT)),
            _image_texture("concrete", "metal1", **_per_metre(0.5, **_MATT)),
            _image_texture("panelling", "wood1", **_per_metre(0.5, **_MATT)),
            _image_texture("marble", "marble1", **_per_metre(0.5, **_MATT)),
        ),
    ),
)

OPEN_CABINET = (
    *ROOM,
    Surface(
        prefix="cabinet/front_", color=cabinet.COLORS["front"], materials=("cabinet/front",), textures=_FRONT_TEXTURES
    ),
    Surface(prefix="cabinet/carcass_", color=cabinet.COLORS["carcass"], materials=("cabinet/carcass",)),
    Surface(prefix="cabinet/tray_", color=cabinet.COLORS["tray"], materials=("cabinet/tray",)),
    Surface(
        prefix="cabinet/worktop_",
        color=(1, 1, 1),
        materials=("cabinet/worktop",),
        textures=(_MARBLE, _speckles("granite", 0.3, 0.7, **_SATIN), _CONCRETE),
    ),
    Surface(prefix="cabinet/handle_", color=cabinet.COLORS["metal"], materials=("cabinet/metal",)),
    FRANKA,
)

MICROWAVE_TABLE = (
    *ROOM,
    Surface(prefix="table/", color=(1, 1, 1), materials=("wood",), textures=(_MARBLE, _LAMINATE, _CONCRETE)),
    Surface(prefix="table/leg_", color=(0.36, 0.47, 0.53), materials=("leg",)),
    Surface(prefix="pedestal/", color=(0.55, 0.56, 0.58), materials=("steel",)),
    *MICROWAVE,
    FRANKA,
)


def light_parameters(root: mjcf.RootElement) -> tuple[Parameter, ...]:
    """Returns the parameters of the lights in the model of a scene, with all that is attached to its `root`.

    Those of the arena share brightness, warmth and direction; the lights of other entities have a brightness each.
    """
    lights = root.find_all("light")
    room = tuple(light for light in lights if light.root is root)
    others = (light for light in lights if light.root is not root)
    return (
        Parameter(name="light/brightness", unit="1", type=BRIGHTNESS, elements=room),
        Parameter(name="light/warmth", unit="1", type=WARMTH, elements=room),
        Parameter(name="light/ambient", unit="1", type=AMBIENT, elements=room[:1]),
        Parameter(name="light/rotation", unit="rad", type=LIGHT_ROTATION, elements=room),
        *(
            Parameter(name=f"{light.full_identifier}_brightness", unit="1", type=BRIGHTNESS, elements=(light,))
            for light in others
        ),
    )


def camera_parameters(root: mjcf.RootElement) -> tuple[Parameter, ...]:
    """Returns offset, rotation and vertical field of view of all cameras of a scene; for `root` see `light_parameters`.

    Their names are such as `camera/left_offset` for a camera `left` of the arena, and `franka/wrist_camera_offset` for
    a camera `wrist` of the robot.
    """
    types = (("offset", "m", CAMERA_OFFSET), ("rotation", "rad", CAMERA_ROTATION), ("fovy", "deg", FIELD_OF_VIEW))
    return tuple(
        Parameter(name=f"{camera_prefix(camera.full_identifier)}{name}", unit=unit, type=each, elements=(camera,))
        for camera in root.find_all("camera")
        for name, unit, each in types
    )


def camera_prefix(camera: str) -> str:
    """Returns the beginning of the names of the parameters of a camera with a given full name."""
    return f"{camera}_camera_" if "/" in camera else f"camera/{camera}_"


def _relative(
    *fields: str,
    change: Callable[[NDArray, NDArray[np.float64]], NDArray],
    default: ArrayLike = 0.0,
    non_negative: bool = False,
) -> ParameterType:
    """Returns a kind of parameter by which fields of lights or cameras differ from the built scene.

    `change` returns their values, given the built ones and the parameter's value; the default one changes nothing.
    """

    def write(physics: mjcf.Physics, elements: Elements, value: NDArray[np.float64]) -> None:
        if not elements:
            return
        ids, model = np.atleast_1d(physics.bind(elements).element_id), physics.model.ptr
        for field in fields:
            values = getattr(model, field)
            values[ids] = change(values[ids], value)

    return ParameterType(
        read=lambda physics, elements: default,
        write=write,
        model_fields=fields,
        shape=np.shape(default),
        non_negative=non_negative,
        visual=True,
    )


def _turned(directions: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    if rotation.any():
        for direction in directions:
            mujoco.mju_rotVecQuat(direction, direction.copy(), _quaternion(rotation))
    return directions


def _turned_frames(quaternions: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    for quaternion in quaternions:
        mujoco.mju_mulQuat(quaternion, quaternion.copy(), _quaternion(rotation))
    return quaternions


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the quaternion of a rotation vector [rad]."""
    angle = np.linalg.norm(rotation)
    quaternion = np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, rotation / (angle or 1.0), angle)
    return quaternion


# Factor of the diffuse and specular colours of lights.
BRIGHTNESS = _relative(
    "light_diffuse", "light_specular", change=lambda colors, factor: colors * factor, default=1.0, non_negative=True
)

# Relative surplus of red, and lack of blue, in the diffuse colours of lights; negative for cold light.
WARMTH = _relative("light_diffuse", change=lambda colors, surplus: colors * np.array([1 + surplus, 1.0, 1 - surplus]))

# Grey light from all sides, added to that of the built scene; 1 lights a white surface fully.
AMBIENT = _relative("light_ambient", change=lambda colors, grey: colors + grey, non_negative=True)

# Rotation vector in the world frame, by which the directions of lights are turned.
LIGHT_ROTATION = _relative("light_dir", change=_turned, default=np.zeros(3))

# Translation from the built position, in the frame of the parent body.
CAMERA_OFFSET = _relative("cam_pos", change=lambda positions, offset: positions + offset, default=np.zeros(3))

# Rotation vector from the built orientation, in the camera's frame: x is right, y up, z backwards.
CAMERA_ROTATION = _relative("cam_quat", change=_turned_frames, default=np.zeros(3))

FIELD_OF_VIEW = shared_value("cam_fovy", visual=True)  # Vertical field of view.

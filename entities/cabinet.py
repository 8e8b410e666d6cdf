"""A cabinet with two drawers above two doors, each with a bar handle; every size and force is a parameter."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

from dm_control import mjcf

from kitchen_suite import checks
from kitchen_suite.entities import assets
from kitchen_suite.entities.parameters import Parameter, displacement, joint_parameters, pose_parameters
from kitchen_suite.entities.props import Prop
from kitchen_suite.types import Vector

DOOR_GAP = 0.003  # Gap around a door, and between a drawer's front and the cabinet's side [m].
_SIGNED = ("drawer_heights", "handle_height")  # Parameters that may be negative.

# Least and greatest value of every other parameter, in its unit. MuJoCo's compiler refuses panels of 1e-9 m, bars of
# 1e-8 m and masses of 1e-14 kg, whose inertia it cannot represent; above 1e10 it takes a simulation to have diverged.
_LEAST, _GREATEST = 1e-6, 1e10

_ROUNDING = 1e-9  # Tolerance for rounding errors in sums of sizes [m].

DRAWERS = ("top", "bottom")
DOORS = ("left", "right")

# Colours of the materials: red, green and blue from 0 to 1.
COLORS: Mapping[str, Vector] = {
    "carcass": (0.80, 0.79, 0.76),
    "front": (0.36, 0.47, 0.53),
    "tray": (0.72, 0.58, 0.42),
    "metal": (0.80, 0.80, 0.82),
}

# `solimpfriction` of slides and hinges. With MuJoCo's default of 0.9 a drawer creeps by 1 mm in a second under 2 N,
# which is less than its dry friction.
_STIFF_FRICTION = (0.99, 0.999, 0.001)


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
        depth, width, height = self.size
        top, bottom = self.drawer_heights
        front = self.drawer_front_height
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


def _check_field(name: str, value: Any, default: Any) -> None:
    """Raises an error unless a value is like the default: a number, or a tuple of as many numbers."""
    what, is_tuple = f"{name} of a cabinet", isinstance(default, tuple)
    if is_tuple and not isinstance(value, tuple):
        raise TypeError(f"{what} must be a tuple of {len(default)} numbers, got {checks.shown(value)}")
    if is_tuple and len(value) != len(default):
        raise ValueError(f"{what} must hold {len(default)} numbers, got {checks.shown(value)}")
    for number in value if is_tuple else (value,):
        if name in _SIGNED:
            checks.vector((number,), 1, what)
        elif not _LEAST <= checks.number(number, what, positive=True) <= _GREATEST:
            raise ValueError(f"{what} must be between {_LEAST:g} and {_GREATEST:g}, got {checks.shown(value)}")


class Cabinet(Prop):
    """The cabinet; the origin of its frame is its centre, x points out of its front."""

    def _build(self, config: CabinetConfig | None = None, *, visuals: bool = True, name: str = "cabinet") -> None:
        """Builds the cabinet with given sizes and resistances, or the default; `name` is the prefix of its elements.

        Without `visuals` it has no visual geoms; the physics stays the same to the bit.
        """
        self._config = config or CabinetConfig()
        self._mjcf_root = assets.new_model(name)
        self._add_defaults()
        self._add_materials()
        self._add_carcass()
        for drawer, height in zip(DRAWERS, self._config.drawer_heights, strict=True):
            self._add_drawer(drawer, height)
        for door, side in zip(DOORS, (-1, 1), strict=True):
            self._add_door(door, side)
        self._mjcf_root.resolve_references()
        if not visuals:
            assets.remove_visuals(self._mjcf_root)

    @property
    def config(self) -> CabinetConfig:
        """Sizes and resistances."""
        return self._config

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """Top and bottom drawer's slide, left and right door's hinge; 0 is closed, opening is positive."""
        names = (*(f"drawer_{drawer}" for drawer in DRAWERS), *(f"door_{door}" for door in DOORS))
        return tuple(self._mjcf_root.find("joint", f"{name}_joint") for name in names)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Offset and yaw of the attached cabinet; friction, damping and displacement of drawers and doors."""
        by_name = {joint.full_identifier.removesuffix("_joint"): joint for joint in self.joints}
        resistances = itertools.starmap(joint_parameters, by_name.items())
        displacements = (displacement(name, (joint,)) for name, joint in by_name.items())
        return (*pose_parameters(self), *itertools.chain.from_iterable(resistances), *displacements)

    def drawer_joint(self, drawer: str) -> mjcf.Element:
        """The slide of the `top` or `bottom` drawer."""
        return self._mjcf_root.find("joint", f"drawer_{drawer}_joint")

    def handle_site(self, drawer: str) -> mjcf.Element:
        """The centre of a drawer's bar, in the orientation of a gripper that holds it: z into the cabinet, y up."""
        return self._mjcf_root.find("site", f"drawer_{drawer}_handle")

    def handle_geoms(self, drawer: str) -> tuple[mjcf.Element, ...]:
        """The geoms of a drawer's handle: first the colliding bar, then the posts and the visual geoms."""
        stem = f"drawer_{drawer}_handle_"
        bar = self._mjcf_root.find("geom", f"{stem}bar")
        return (bar, *(geom for geom in bar.parent.geom if stem in geom.name and geom != bar))

    def _add_defaults(self) -> None:
        top = self._mjcf_root.default
        visual = top.add("default", dclass="visual")
        visual.geom.set_attributes(group=1, contype=0, conaffinity=0, mass=0)
        # Contype 0: no contacts among parts of the cabinet and the floor. The robot, of contype 1, still collides.
        collision = top.add("default", dclass="collision")
        collision.geom.set_attributes(group=4, contype=0, conaffinity=1, mass=0)

    def _add_materials(self) -> None:
        asset = self._mjcf_root.asset
        asset.add("texture", name="wood", type="cube", file="kitchen_assets/textures/wood1.png")
        asset.add("material", name="worktop", texture="wood", specular=0.2, shininess=0.3)
        asset.add("material", name="carcass", rgba=(*COLORS["carcass"], 1), specular=0.1, shininess=0.1)
        asset.add("material", name="front", rgba=(*COLORS["front"], 1), specular=0.3, shininess=0.4)
        asset.add("material", name="tray", rgba=(*COLORS["tray"], 1), specular=0.1, shininess=0.1)
        asset.add("material", name="metal", rgba=(*COLORS["metal"], 1), specular=0.9, shininess=0.9, reflectance=0.1)

    def _add_carcass(self) -> None:
        depth, width, height = self._config.size
        panel = self._config.panel
        worktop = self._config.worktop
        body = self._mjcf_root.worldbody.add("body", name="carcass")
        # The carcass is behind the fronts; the worktop covers the fronts as well.
        middle, half_depth = -panel / 2, (depth - panel) / 2
        half_width, top = width / 2, height / 2 - worktop
        side_z, side_half = (top - height / 2) / 2, (top + height / 2) / 2
        for name, sign in (("left", -1), ("right", 1)):
            pos = (middle, sign * (half_width - panel / 2), side_z)
            self._add_box(body, f"{name}_side", pos, (half_depth, panel / 2, side_half), "carcass")
        inner = half_width - panel
        self._add_box(body, "back", (-(depth - panel) / 2, 0, side_z), (panel / 2, inner, side_half), "carcass")
        self._add_box(body, "plinth", (middle, 0, 0.03 - height / 2), (half_depth - panel, inner, 0.03), "carcass")
        low, high = self._config.door_span
        for name, z in (("floor", low), ("shelf", high)):
            self._add_box(body, name, (middle, 0, z), (half_depth, inner, panel / 2), "carcass")
        pos = (0.005, 0, height / 2 - worktop / 2)
        self._add_box(body, "worktop", pos, (depth / 2 + 0.005, half_width + 0.01, worktop / 2), "worktop")

    def _add_drawer(self, drawer: str, height: float) -> None:
        config = self._config
        body = self._mjcf_root.worldbody.add("body", name=f"drawer_{drawer}", pos=(0, 0, height))
        resistance = {"frictionloss": config.drawer_friction, "damping": config.drawer_damping}
        self._add_joint(body, type="slide", axis=(1, 0, 0), range=(0, config.drawer_travel), **resistance)
        for name, (pos, half_size, mass) in self._drawer_panels().items():
            material = "front" if name == "front" else "tray"
            self._add_box(body, f"drawer_{drawer}_{name}", pos, half_size, material, mass)
        self._add_handle(body, f"drawer_{drawer}", config.handle_position, upright=False)

    def _drawer_panels(self) -> dict[str, tuple[Vector, Vector, float]]:
        """Returns positions and half sizes in the drawer's frame [m], and masses [kg], proportional to the volumes."""
        config = self._config
        thin, inner = config.panel / 2, config.size[1] / 2 - 2 * config.panel
        back, front = -config.front + 3 * config.panel, config.front - config.panel
        middle = (front + back) / 2
        half_depth = (front - back) / 2
        rim = 0.3 * config.drawer_front_height
        panels = {
            "front": ((front + thin, 0, 0), (thin, config.size[1] / 2 - DOOR_GAP, config.drawer_front_height / 2)),
            "bottom": ((middle, 0, -rim), (half_depth, inner, thin / 2)),
            "left": ((middle, -inner, 0), (half_depth, thin / 2, rim)),
            "right": ((middle, inner, 0), (half_depth, thin / 2, rim)),
            "back": ((back, 0, 0), (thin / 2, inner, rim)),
        }
        volume = sum(math.prod(half_size) for _, half_size in panels.values())
        density = config.drawer_mass / volume
        return {name: (pos, half, density * math.prod(half)) for name, (pos, half) in panels.items()}

    def _add_door(self, door: str, side: int) -> None:
        """Adds the door on the -y (`side` -1) or the +y (`side` 1) half, hinged at its outer edge."""
        config = self._config
        (low, high), half_width = config.door_span, config.size[1] / 4 - DOOR_GAP
        hinge = (config.front - config.panel / 2, side * (config.size[1] / 2 - DOOR_GAP), (low + high) / 2)
        body = self._mjcf_root.worldbody.add("body", name=f"door_{door}", pos=hinge)
        resistance = {"frictionloss": config.door_friction, "damping": config.door_damping}
        self._add_joint(body, type="hinge", axis=(0, 0, side), range=(0, math.pi / 2), **resistance)
        half_size = (config.panel / 2, half_width, (high - low) / 2 - DOOR_GAP)
        self._add_box(body, f"door_{door}_panel", (0, -side * half_width, 0), half_size, "front", config.door_mass)
        reach = config.panel / 2 + config.handle_clearance + config.handle_radius
        self._add_handle(body, f"door_{door}", (reach, -side * (2 * half_width - 0.05), 0), upright=True)

    def _add_joint(self, body: mjcf.Element, **attributes: Any) -> None:
        body.add("joint", name=f"{body.name}_joint", solimpfriction=_STIFF_FRICTION, **attributes)

    def _add_box(
        self, body: mjcf.Element, name: str, pos: Vector, half_size: Vector, material: str, mass: float = 0.0
    ) -> None:
        """Adds a panel: a colliding geom with the mass [kg], and a visual geom."""
        body.add("geom", name=name, dclass="collision", type="box", pos=pos, size=half_size, mass=mass)
        body.add("geom", name=f"{name}_visual", dclass="visual", type="box", pos=pos, size=half_size, material=material)

    def _add_handle(self, body: mjcf.Element, stem: str, pos: Vector, *, upright: bool) -> None:
        """Adds a bar on two posts, and the site at its centre."""
        config, (x, y, z) = self._config, pos
        along = (0, 0, config.handle_half_length) if upright else (0, config.handle_half_length, 0)
        parts = {"bar": (x, y - along[1], z - along[2], x, y + along[1], z + along[2])}
        for name, share in (("post_a", -0.87), ("post_b", 0.87)):
            foot = (y + share * along[1], z + share * along[2])
            parts[name] = (x, *foot, x - config.handle_clearance - config.handle_radius, *foot)
        friction = (config.handle_friction, 0.005, 0.0001)
        for name, ends in parts.items():
            shape = {"type": "capsule", "size": (config.handle_radius,), "fromto": ends}
            body.add("geom", name=f"{stem}_handle_{name}", dclass="collision", friction=friction, **shape)
            body.add("geom", name=f"{stem}_handle_{name}_visual", dclass="visual", material="metal", **shape)
        # The quaternion is exact for these right angles, and its w is far from zero, where its sign would flip.
        frame = {"xyaxes": (0, 0, 1, 0, 1, 0)} if upright else {"quat": (0.5, 0.5, -0.5, -0.5)}
        body.add("site", name=f"{stem}_handle", pos=pos, size=(0.008,), group=3, **frame)

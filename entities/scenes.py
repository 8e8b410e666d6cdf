"""Scenes of an arena, a robot and props."""

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from dm_control import composer, mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities import appearance, assets
from kitchen_suite.entities import props as kitchen_props
from kitchen_suite.entities.appearance import Surface
from kitchen_suite.entities.arms import FRANKA, make_robot
from kitchen_suite.entities.arms.franka import PANDA
from kitchen_suite.entities.cabinet import Cabinet, CabinetConfig
from kitchen_suite.entities.joints import position_sizes
from kitchen_suite.entities.parameters import POSITION_OFFSET, SLIDING_FRICTION_SCALE, Parameter, scale
from kitchen_suite.entities.props import Microwave, Prop
from kitchen_suite.entities.robot import Robot, RobotSpec
from kitchen_suite.physics_names import EXACT, FAST, HOLDING_KEY, PHYSICS, PHYSICS_KEY

_PEDESTAL_RADIUS = 0.05  # Radius of the pedestal in generated kitchens [m].
_PLINTH_RADIUS = 0.09  # Radius of the plinth on the pedestal below a robot that stands higher [m].
FLOOR = 0.82  # Height of the floor of generated kitchens [m]: their counters are 0.9 m above it.

# Position [m] and axes of the camera `overview` of generated kitchens: 3.05 m from (0, 0.3, 1.87), azimuth 82 and
# elevation -31 degrees.
_OVERVIEW = (-0.364, -2.289, 3.441), (0.9903, -0.1392, 0.0, 0.0717, 0.51, 0.8572)

# Speed below which MuJoCo may put an object to sleep [m/s; rad/s scaled by the object's length].
_SLEEP_TOLERANCE = 1e-8


@dataclasses.dataclass(frozen=True, kw_only=True)
class FastPhysics:
    """Another integration of the same model, with fewer and longer physics steps; docs/guide/fast_physics.md.

    Objects at rest sleep.

    Attributes:
      timestep: length of a physics step [s], a whole fraction of the control step.
      integrator: MuJoCo's name of the integrator.
      cone: MuJoCo's name of the model of friction; `elliptic` keeps grasps and pushes as they are with short steps.
      sleep_tolerance: speed below which an object may be put to sleep [m/s; rad/s scaled by its length].
      refsafe: whether MuJoCo makes contacts and limits softer whose time constants are below two physics steps.
      holding_timestep: length of a physics step with which fingers hold a free object [s], see `HOLDING_OPTIONS`; None
        refuses scenes with one.
    """

    timestep: float
    integrator: str = "implicitfast"
    cone: str = "elliptic"
    sleep_tolerance: float = 1e-4
    refsafe: bool = False
    holding_timestep: float | None = None


# Options of MuJoCo with which fingers hold an object by friction; docs/results/holding.md has what was measured.
# Without the first it slowly slips out of them, and with pyramidal cones a narrow box of 0.3 kg still does.
HOLDING_OPTIONS: Mapping[str, Any] = MappingProxyType({"noslip_iterations": 3, "cone": "elliptic"})


class SiteArena(assets.NamedEntity, composer.Arena):
    """Floor, lights, cameras, and a site at the pose of each entity.

    Attributes:
      surfaces: of the scene, with all entities that are attached to the arena.
      fast_physics: what `fast` physics is in the scene; None if there is none.
      physics: one of `PHYSICS`.
    """

    xml_name: str
    default_name: str
    surfaces: Sequence[Surface] = ()
    fast_physics: FastPhysics | None = None
    physics: str = EXACT

    def _build(self, *, visuals: bool = True, name: str | None = None) -> None:
        """Loads the arena's MJCF; the model's `name` is the arena's own when omitted.

        Without `visuals` it has no visual geoms, materials and textures; the physics stays the same to the bit.
        """
        self._mjcf_root = assets.load_mjcf(self.xml_name, visuals=visuals)
        self._mjcf_root.model = name or self.default_name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sliding friction, appearance of surfaces, lights and cameras, those of attached entities included."""
        root = self._mjcf_root
        geoms = [geom for geom in root.find_all("geom") if not assets.is_visual(geom)]
        friction = scale(f"{root.model}/friction_scale", SLIDING_FRICTION_SCALE, geoms)
        surfaces = (parameter for surface in self.surfaces for parameter in surface.parameters)
        return (friction, *surfaces, *appearance.light_parameters(root), *appearance.camera_parameters(root))

    def enable_sleep(self) -> None:
        """Lets MuJoCo put objects at rest to sleep; never the robot, which has actuators.

        A sleeping object keeps its position to within 1e-8 rad or m. The robot moves the same up to rounding until it
        touches an object; after that trajectories diverge, as after any change in the last digits.
        """
        self._mjcf_root.option.flag.sleep = "enable"
        self._mjcf_root.option.sleep_tolerance = _SLEEP_TOLERANCE

    def attach_at_site(self, entity: composer.Entity, *, free: bool = False) -> mjcf.Element:
        """Attaches an entity at the site with its model's name, perhaps with a free joint; returns the frame."""
        name = entity.mjcf_model.model
        sites = {site.name: site for site in self._mjcf_root.find_all("site", exclude_attachments=True)}
        if name not in sites:
            raise ValueError(f"the arena has no site for {name!r}; its sites are {sorted(sites)}")
        frame = self.attach(entity, sites[name])
        if free:
            frame.add("freejoint")
        return frame

    def attach_robot(self, robot: Robot) -> mjcf.Element:
        """Attaches a robot at the site with its model's name; returns the frame."""
        return self.attach_at_site(robot)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """A robot and props in an arena; the positions of the props' joints, end to end, are the object positions.

    Attributes:
      arena: the arena, with everything else attached to it.
      robot: the Franka, or another arm in the kitchen.
      props: the objects by name, in the order in which their joints are observed.
      attached: entities that `attach` added, by name; the domain's tasks neither observe nor reward them.
    """

    arena: SiteArena
    robot: Robot
    props: Mapping[str, Prop]
    attached: dict[str, composer.Entity] = dataclasses.field(default_factory=dict)

    @classmethod
    def furnish(cls, arena: SiteArena, robot: Robot, props: Iterable[Prop]) -> Self:
        """Attaches a robot and props, in the order of observation, at the arena's sites of their names."""
        by_name = {prop.mjcf_model.model: prop for prop in props}
        arena.attach_robot(robot)
        for prop in by_name.values():
            arena.attach_at_site(prop, free=prop.free)
        return cls(arena=arena, robot=robot, props=MappingProxyType(by_name))

    def attach(
        self,
        entity: composer.Entity,
        *,
        pos: ArrayLike = (0.0, 0.0, 0.0),
        quat: ArrayLike = (1.0, 0.0, 0.0, 0.0),
        free: bool = False,
    ) -> mjcf.Element:
        """Attaches any composer entity to the arena; to be called before the scene is given to a task's base class.

        Every episode starts with it there. Its elements have the prefix of its model's name, such as `mug/`. Tasks take
        `<name>/pose` among their `extra_observables`; see also `SuiteTask.extra_observations`.

        Args:
          entity: one of the suite's, of dm_control's, or of a user's own.
          pos: `(3,)`, position of its frame in the world [m].
          quat: `(4,)`, orientation of its frame, w, x, y, z.
          free: whether it moves freely; it stands fixed otherwise.

        Returns:
          The frame.

        Raises:
          TypeError: it is no composer entity, or a pose does not hold numbers.
          ValueError: something in the scene has its name, or a pose has another shape or is not finite.
        """
        if not isinstance(entity, composer.Entity):
            raise TypeError(f"entity must be a composer.Entity, got {checks.shown(entity)}")
        name = entity.mjcf_model.model
        taken = {self.robot.mjcf_model.model, *self.props, *self.attached}
        if name in taken:
            raise ValueError(f"the scene has an entity {name!r} already: give this one's MJCF model another name")
        pose = {"pos": checks.vector(pos, 3, "pos"), "quat": checks.vector(quat, 4, "quat")}
        frame = self.arena.attach(entity)
        frame.set_attributes(**pose)
        if checks.boolean(free, "free"):
            frame.add("freejoint")
        self.attached[name] = entity
        return frame

    @property
    def physics(self) -> str:
        """How the physics is integrated: one of `PHYSICS`."""
        return self.arena.physics

    @property
    def physics_timestep(self) -> float:
        """Length of a physics step [s]."""
        return float(self.arena.mjcf_model.option.timestep)

    @property
    def sleeps(self) -> bool:
        """Whether objects at rest are left out of the physics until something touches them."""
        return self.arena.mjcf_model.option.flag.sleep == "enable"

    @property
    def has_fast_physics(self) -> bool:
        """Whether the scene has settings for the physics `fast`."""
        return self.arena.fast_physics is not None

    def use_physics(self, physics: str) -> None:
        """Makes the physics one of `PHYSICS`; to be called once, before the scene is given to a task.

        Raises a TypeError or a ValueError if there is no such physics in this scene.
        """
        if checks.choice(physics, PHYSICS, "physics") == EXACT:
            return
        arena = self.arena
        if arena.fast_physics is None:
            raise ValueError(f"this scene has no {FAST} physics: leave out physics")
        arena.enable_sleep()
        options = dataclasses.asdict(arena.fast_physics)
        del options["holding_timestep"]
        arena.mjcf_model.option.flag.refsafe = "enable" if options.pop("refsafe") else "disable"
        for name, value in options.items():
            setattr(arena.mjcf_model.option, name, value)
        arena.physics = physics

    @property
    def free_objects(self) -> list[str]:
        """Names of the objects that move freely and that fingers may hold; not the kettle, whose physics is tuned."""
        tuned = [joint for prop in self.props.values() if prop.is_tuned for joint in prop.joints]
        free = (joint for joint in self.arena.mjcf_model.find_all("joint") if joint.tag == "freejoint")
        return [joint.parent.full_identifier.rstrip("/") for joint in free if joint not in tuned]

    def hold_free_objects(self) -> None:
        """Chooses options of the physics with which fingers hold the scene's free objects; nothing where it has none.

        To be called once, after everything has been attached and before the scene is compiled. Options that a user has
        set in the MJCF stay.

        Raises a ValueError if the scene's physics is one that holds no object.
        """
        if not (names := self.free_objects):
            return
        option, fast = self.arena.mjcf_model.option, self.arena.fast_physics
        if self.physics == FAST and fast is not None:
            if fast.holding_timestep is None:
                raise ValueError(
                    f"{FAST} physics of this scene throws free objects such as {names[0]!r} out of the fingers, since "
                    f"its steps of {fast.timestep:g} s are too long: use physics={EXACT!r}, or set holding_timestep of "
                    "the arena's fast_physics; see docs/guide/your_task.md"
                )
            option.timestep = fast.holding_timestep
        for name, value in HOLDING_OPTIONS.items():
            if getattr(option, name) is None:
                setattr(option, name, value)

    @property
    def info(self) -> dict[str, str]:
        """Infos on the physics: its name unless it is the exact one, and the options that hold free objects."""
        named = {} if self.physics == EXACT else {PHYSICS_KEY: self.physics}
        if not self.free_objects:
            return named
        option = self.arena.mjcf_model.option
        held = f"{option.timestep * 1000:g} ms, {option.cone or 'pyramidal'}, noslip {option.noslip_iterations or 0}"
        return {**named, HOLDING_KEY: held}

    def prepare_appearance(self) -> None:
        """Adds the textures from which a reset may choose; to be called before the scene is compiled.

        Physics and images stay the same to the bit until one is chosen. Without visuals, it adds nothing.
        """
        appearance.add_variants(self.arena.mjcf_model, self.arena.surfaces)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of arena, robot and props."""
        attached = (entity for entity in self.attached.values() if isinstance(entity, assets.NamedEntity))
        entities = (self.arena, self.robot, *self.props.values(), *attached)
        return tuple(parameter for entity in entities for parameter in entity.parameters)

    @property
    def object_joints(self) -> tuple[mjcf.Element, ...]:
        """The joints of all props, in the order of observation."""
        return tuple(joint for prop in self.props.values() for joint in prop.joints)

    def joints(self, prop: str, names: Sequence[str] | None = None) -> tuple[mjcf.Element, ...]:
        """Returns joints of a prop, all or those of some names in its own model; an unknown name is a ValueError."""
        joints = self.props[checks.choice(prop, self.props, "prop")].joints
        if names is None:
            return joints
        by_name = {joint.name: joint for joint in joints}
        return tuple(by_name[checks.choice(name, by_name, f"joint of {prop!r}")] for name in names)

    def elements(self, prop: str, names: Sequence[str] | None = None) -> NDArray[np.int64]:
        """Returns the indices `(k,)` of the positions of some joints among the object positions; see `joints`."""
        observed, wanted = self.object_joints, self.joints(prop, names)
        sizes = position_sizes(observed)
        by_joint = dict(zip(observed, np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1]), strict=True))
        return np.concatenate([by_joint[joint] for joint in wanted])


# In the order in which their joints are observed.
_PROPS: tuple[type[kitchen_props.KitchenProp], ...] = (
    kitchen_props.Counter,
    kitchen_props.Oven,
    kitchen_props.Hood,
    kitchen_props.Walls,
    kitchen_props.SlideCabinet,
    kitchen_props.HingeCabinet,
    kitchen_props.Microwave,
    kitchen_props.Kettle,
)


class KitchenArena(SiteArena):
    """Floor, lights, cameras, the robot's pedestal, and a site for the robot and for each prop."""

    xml_name = "kitchen_arena"
    default_name = "kitchen"
    surfaces: Sequence[Surface] = appearance.KITCHEN
    # A sixth of a control step; a tenth where objects are held.
    fast_physics: FastPhysics | None = FastPhysics(timestep=0.08 / 6, holding_timestep=0.08 / 10)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of every arena, and the offset of the pedestal, with which the robot moves."""
        pedestal = self._mjcf_root.find("body", "pedestal")
        offset = Parameter(name="pedestal/offset", unit="m", type=POSITION_OFFSET, elements=(pedestal,))
        return (*super().parameters, offset)

    def attach_robot(self, robot: Robot) -> mjcf.Element:
        """Attaches a robot where its specification says, on a plinth if it stands higher than the pedestal."""
        where = robot.specification
        site = self._mjcf_root.find("site", FRANKA)
        site.set_attributes(name=robot.mjcf_model.model, pos=where.base_pos, quat=where.base_quat)
        x, y, height = where.base_pos
        if height > 0.0:
            shape = {"type": "cylinder", "size": (_PLINTH_RADIUS, height / 2), "pos": (x, y, height / 2), "mass": 0}
            site.parent.add("geom", name="plinth", **shape)
        return super().attach_robot(robot)


class GeneratedKitchenArena(KitchenArena):
    """The kitchen's arena without furniture, with a floor that suits counters of usual height, and walls by design."""

    surfaces = ()

    def _build(self, *, visuals: bool = True, name: str | None = None) -> None:
        super()._build(visuals=visuals, name=name)
        world = self._mjcf_root.worldbody
        world.find("body", "desk").remove()
        self._mjcf_root.find("site", "kettle").remove()
        self._mjcf_root.find("geom", "floor").pos = (0, 0, FLOOR)
        # The kitchen's would cut off upper cabinets, and shadows on the higher floor.
        self._mjcf_root.find("camera", "overview").set_attributes(pos=_OVERVIEW[0], xyaxes=_OVERVIEW[1])
        self._mjcf_root.visual.map.shadowclip = 1.0
        # Narrower than in the original kitchen, where the front of the oven is in the pedestal.
        self._mjcf_root.find("geom", "pedestal").size = (_PEDESTAL_RADIUS, 0.9)

    def attach_at(self, entity: composer.Entity, position: NDArray[np.float64], yaw: float) -> mjcf.Element:
        """Attaches an entity at a position [m], rotated about the vertical by `yaw` [rad]; returns the frame."""
        frame = self.attach(entity)
        frame.set_attributes(pos=position, quat=(np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)))
        return frame

    def add_box(self, name: str, low: ArrayLike, high: ArrayLike, **attributes: Any) -> None:
        """Adds a box between two corners [m], which only images show; attributes are its colour or material."""
        pos, size = np.add(low, high) / 2, np.subtract(high, low) / 2
        shape = {"type": "box", "pos": pos, "size": size, "group": 1}
        self._mjcf_root.worldbody.add("geom", name=name, contype=0, conaffinity=0, mass=0, **shape, **attributes)


@functools.cache
def robot_base() -> NDArray[np.float64]:
    """Position `(3,)` of the robot's base in the kitchens [m]."""
    position: NDArray[np.float64] = assets.load_mjcf(KitchenArena.xml_name, visuals=False).find("body", "pedestal").pos
    position.flags.writeable = False
    return position


def build_kitchen_scene(*, visuals: bool = True, sleep: bool = False, robot: str | RobotSpec = FRANKA) -> Scene:
    """Builds the kitchen of FrankaKitchen-v1, whose props have 21 positions and 20 velocities.

    Args:
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
      sleep: whether objects at rest are left out of the physics until something touches them, which is faster;
        trajectories are then nearly the same. See `SiteArena.enable_sleep`.
      robot: `franka`, a `RobotSpec`, or one as `module:NAME`; see docs/guide/arms.md. Its options of
        the physics may be others.
    """
    arena, arm = KitchenArena(visuals=visuals), make_robot(robot, visuals=visuals)
    if options := arm.specification.physics_options:
        arena.mjcf_model.option.set_attributes(**options)
        # Hands that need them are not stable with longer steps.
        arena.fast_physics = None
    if checks.boolean(sleep, "sleep"):
        arena.enable_sleep()
    scene = Scene.furnish(arena, arm, [prop(visuals=visuals) for prop in _PROPS])
    exclude_base_contacts(arena, arm)
    return scene


def exclude_base_contacts(arena: KitchenArena, robot: Robot) -> None:
    """Excludes contacts between the robot's base and its first link, which saves collision checks.

    The Franka's are 1 mm apart at every joint angle. MuJoCo itself excludes contacts between parent and child bodies,
    but not where the parent is fixed to the world.
    """
    first = robot.joints[0].parent
    base = first.parent
    if base.tag == "body":
        arena.mjcf_model.contact.add("exclude", name="base_and_first_link", body1=base, body2=first)


class MicrowaveTableArena(SiteArena):
    """Floor, wall, lights, cameras, pedestal, table, and a site for the robot and for the microwave, face to face."""

    xml_name = "microwave_table_arena"
    default_name = "room"
    surfaces = appearance.MICROWAVE_TABLE
    # A whole control step, which holds no object, and half of it is the step of the exact physics.
    fast_physics = FastPhysics(timestep=0.01)


def build_microwave_table_scene(*, visuals: bool = True) -> Scene:
    """Builds the scene of the microwave_table domain: the Panda, in its own joint convention, before the microwave.

    Args:
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    arena, robot = MicrowaveTableArena(visuals=visuals), Robot(PANDA, visuals=visuals)
    return Scene.furnish(arena, robot, [Microwave(visuals=visuals)])


class OpenCabinetArena(SiteArena):
    """Floor, walls, lights, cameras, a site for the robot, facing -x, and one for the cabinet's centre, facing +x."""

    xml_name = "cabinet_arena"
    default_name = "room"
    surfaces = appearance.OPEN_CABINET


class OpenCabinetScene(Scene):
    """The Panda, in its own joint convention, in front of a cabinet."""

    @property
    def cabinet(self) -> Cabinet:
        """The cabinet with the drawers to open."""
        cabinet = self.props["cabinet"]
        assert isinstance(cabinet, Cabinet)
        return cabinet


def build_open_cabinet_scene(cabinet_config: CabinetConfig | None = None, *, visuals: bool = True) -> OpenCabinetScene:
    """Builds the scene of the open_cabinet domain.

    Args:
      cabinet_config: sizes and resistances of the cabinet, a `CabinetConfig`; the default ones when omitted.
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    if not isinstance(cabinet_config, CabinetConfig | None):
        raise TypeError(f"cabinet_config must be a CabinetConfig, got {checks.shown(cabinet_config)}")
    arena, robot = OpenCabinetArena(visuals=visuals), Robot(PANDA, visuals=visuals)
    return OpenCabinetScene.furnish(arena, robot, [Cabinet(cabinet_config, visuals=visuals)])

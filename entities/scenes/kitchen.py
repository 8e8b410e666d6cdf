"""The kitchen's arena, and the scene of the kitchen domain: arena, robot and props."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from kitchen_suite.entities import surfaces
from kitchen_suite.entities.parameters import POSITION_OFFSET, Parameter
from kitchen_suite.entities.props import kitchen as kitchen_props
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.scenes.arena import SiteArena
from kitchen_suite.entities.scenes.scene import Scene

# Speed below which MuJoCo may put an object to sleep [m/s; rad/s scaled by the object's length].
_SLEEP_TOLERANCE = 1e-8

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

# Names of the joints of each prop with joints, in the order in which these are observed.
JOINT_NAMES: Mapping[str, Sequence[str]] = MappingProxyType(
    {prop.xml_name: prop.joint_names for prop in _PROPS if prop.joint_names}
)

# Names of these props.
OBSERVED_PROPS = tuple(JOINT_NAMES)


class KitchenArena(SiteArena):
    """Floor, lights, cameras, the robot's pedestal, and a site for the robot and for each prop."""

    xml_name = "kitchen_arena"
    default_name = "kitchen"
    surfaces = surfaces.KITCHEN

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of every arena, and the offset of the pedestal, with which the robot moves."""
        pedestal = self._mjcf_root.find("body", "pedestal")
        offset = Parameter(name="pedestal/offset", unit="m", quantity=POSITION_OFFSET, elements=(pedestal,))
        return (*super().parameters, offset)

    def enable_sleep(self) -> None:
        """Lets MuJoCo put objects at rest to sleep; never the robot, which has actuators.

        A sleeping object keeps its position to within 1e-8 rad or m. The robot moves the same up to rounding until it
        touches an object; after that trajectories diverge, as after any change in the last digits.
        """
        self._mjcf_root.option.flag.sleep = "enable"
        self._mjcf_root.option.sleep_tolerance = _SLEEP_TOLERANCE


def build_kitchen_scene(*, visuals: bool = True, sleep: bool = False) -> Scene:
    """Builds the kitchen of FrankaKitchen-v1, whose props have 21 positions and 20 velocities.

    Args:
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
      sleep: whether objects at rest are left out of the physics until something touches them, which is faster still;
        trajectories are then nearly the same (see `KitchenArena.enable_sleep`).
    """
    arena, robot = KitchenArena(visuals=visuals), Franka(visuals=visuals)
    if sleep:
        arena.enable_sleep()
    scene = Scene.furnish(arena, robot, [prop(visuals=visuals) for prop in _PROPS])
    _exclude_base_contacts(arena, robot)
    return scene


def in_observed_order(by_prop: Mapping[str, Sequence[float]]) -> list[float]:
    """Returns numbers by prop as one list, in the order in which the kitchen's joints are observed."""
    return [number for name in OBSERVED_PROPS for number in by_prop[name]]


def _exclude_base_contacts(arena: KitchenArena, robot: Franka) -> None:
    """Excludes contacts between the robot's base and its first link, which saves collision checks.

    They are 1 mm apart at every joint angle. MuJoCo itself excludes contacts between parent and child bodies, but not
    where the parent is fixed to the world.
    """
    base, first = (robot.mjcf_model.find("body", name) for name in ("link0", "link1"))
    arena.mjcf_model.contact.add("exclude", name="base_and_first_link", body1=base, body2=first)

"""The kitchen's arena, and the scene of the kitchen domain: arena, robot and props."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

from dm_control import mjcf

from kitchen_suite.entities.props import kitchen as kitchen_props
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.scenes.arena import SiteArena

# Speed below which MuJoCo may put an object to sleep [m/s; rad/s scaled by the object's length].
_SLEEP_TOLERANCE = 1e-8

# Props without a free joint, in the order in which their joints are observed.
_FIXED_PROPS = (
    kitchen_props.Counter,
    kitchen_props.Oven,
    kitchen_props.Hood,
    kitchen_props.Walls,
    kitchen_props.SlideCabinet,
    kitchen_props.HingeCabinet,
    kitchen_props.Microwave,
)


class KitchenArena(SiteArena):
    """Floor, lights, cameras, the robot's pedestal, and a site for the robot and for each prop."""

    xml_name = "kitchen_arena"
    default_name = "kitchen"

    def enable_sleep(self) -> None:
        """Lets MuJoCo put objects at rest to sleep; never the robot, which has actuators.

        A sleeping object keeps its position to within 1e-8 rad or m. The robot moves the same up to rounding until it
        touches an object; after that trajectories diverge, as after any change in the last digits.
        """
        self._mjcf_root.option.flag.sleep = "enable"
        self._mjcf_root.option.sleep_tolerance = _SLEEP_TOLERANCE


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenScene:
    """A furnished kitchen.

    Attributes:
      arena: the arena, with everything else attached to it.
      robot: the Franka on its pedestal.
      props: the objects by name, in the order in which their joints are observed.
    """

    arena: KitchenArena
    robot: Franka
    props: Mapping[str, kitchen_props.KitchenProp]

    @property
    def object_joints(self) -> tuple[mjcf.Element, ...]:
        """The props' joints in the order of the observation: 21 positions, 20 velocities."""
        return tuple(joint for prop in self.props.values() for joint in prop.joints)


def build_kitchen_scene(*, visuals: bool = True, sleep: bool = False) -> KitchenScene:
    """Builds the kitchen of FrankaKitchen-v1.

    Args:
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
      sleep: whether objects at rest are left out of the physics until something touches them, which is faster still;
        trajectories are then nearly the same (see `KitchenArena.enable_sleep`).
    """
    arena = KitchenArena(visuals=visuals)
    if sleep:
        arena.enable_sleep()
    robot = Franka(visuals=visuals)
    arena.attach_at_site(robot)
    fixed = [prop(visuals=visuals) for prop in _FIXED_PROPS]
    for prop in fixed:
        arena.attach_at_site(prop)
    kettle = kitchen_props.Kettle(visuals=visuals)
    arena.attach_at_site(kettle, free=True)
    _exclude_base_contacts(arena, robot)
    by_name = {prop.mjcf_model.model: prop for prop in (*fixed, kettle)}
    return KitchenScene(arena=arena, robot=robot, props=MappingProxyType(by_name))


def _exclude_base_contacts(arena: KitchenArena, robot: Franka) -> None:
    """Excludes contacts between the robot's base and its first link, which saves collision checks.

    They are 1 mm apart at every joint angle. MuJoCo itself excludes contacts between parent and child bodies, but not
    where the parent is fixed to the world.
    """
    base, first = (robot.mjcf_model.find("body", name) for name in ("link0", "link1"))
    arena.mjcf_model.contact.add("exclude", name="base_and_first_link", body1=base, body2=first)

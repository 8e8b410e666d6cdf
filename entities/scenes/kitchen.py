"""The kitchen's room, and the kitchen as a whole: room, robot and props put together."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

from dm_control import composer, mjcf

from kitchen_suite.entities import assets
from kitchen_suite.entities.props import kitchen as kitchen_props
from kitchen_suite.entities.robots.franka import Franka

# Speed below which a thing counts as resting [m/s, rad/s scaled by the thing's length].
_SLEEP_TOLERANCE = 1e-8


class KitchenArena(composer.Arena):
    """Floor, lights, cameras, the robot's pedestal, and named places for everything else."""

    def _build(self, *, visuals: bool = True, name: str = "kitchen") -> None:
        """Reads the room's MJCF.

        Args:
          visuals: `False` leaves out materials and textures; the physics stays the same to the bit.
          name: name of the model.
        """
        self._mjcf_root = assets.load_mjcf("kitchen_arena", visuals=visuals)
        self._mjcf_root.model = name

    def enable_sleep(self) -> None:
        """Lets MuJoCo put to sleep what has come to rest; never the robot, which has actuators.

        A thing at rest stays where it is to within 1e-8 rad or m. The robot moves the same to rounding until it touches
        something; from then on trajectories part, as they do after any change in the last digits.
        """
        self._mjcf_root.option.flag.sleep = "enable"
        self._mjcf_root.option.sleep_tolerance = _SLEEP_TOLERANCE

    def place(self, entity: composer.Entity, *, free: bool = False) -> mjcf.Element:
        """Attaches an entity at the place that has its name, and returns the frame it hangs on.

        Args:
          entity: its model name must be that of a site of the room.
          free: whether it moves freely.

        Raises:
          ValueError: the room has no place of that name.
        """
        name = entity.mjcf_model.model
        places = {site.name: site for site in self._mjcf_root.find_all("site", exclude_attachments=True)}
        if name not in places:
            raise ValueError(f"the kitchen has no place for {name!r}; its places are {sorted(places)}")
        frame = self.attach(entity, places[name])
        if free:
            frame.add("freejoint")
        return frame


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenScene:
    """A furnished kitchen.

    Attributes:
      arena: the room, which everything else is attached to.
      robot: the Franka on its pedestal.
      props: the things in the room by name, in the order in which their joints are observed.
    """

    arena: KitchenArena
    robot: Franka
    props: Mapping[str, kitchen_props.KitchenProp]

    @property
    def object_joints(self) -> tuple[mjcf.Element, ...]:
        """The props' joints in the order of the observation: 21 positions, 20 velocities."""
        return tuple(joint for prop in self.props.values() for joint in prop.joints)


def build_kitchen_scene(*, visuals: bool = True, sleep: bool = False) -> KitchenScene:
    """Puts the kitchen of FrankaKitchen-v1 together.

    Args:
      visuals: `False` leaves out all geoms that only the eye needs, which is faster; trajectories are the same to the
        bit.
      sleep: whether things that have come to rest are left out of the physics until something touches them, which is
        faster still; trajectories are then nearly the same (see `KitchenArena.enable_sleep`).
    """
    arena = KitchenArena(visuals=visuals)
    if sleep:
        arena.enable_sleep()
    robot = Franka(visuals=visuals)
    arena.place(robot)
    fixed = (
        kitchen_props.Counter,
        kitchen_props.Oven,
        kitchen_props.Hood,
        kitchen_props.Walls,
        kitchen_props.SlideCabinet,
        kitchen_props.HingeCabinet,
        kitchen_props.Microwave,
    )
    props = [prop(visuals=visuals) for prop in fixed]
    for prop in props:
        arena.place(prop)
    kettle = kitchen_props.Kettle(visuals=visuals)
    arena.place(kettle, free=True)
    _exclude_base_contacts(arena, robot)
    by_name = {prop.mjcf_model.model: prop for prop in (*props, kettle)}
    return KitchenScene(arena=arena, robot=robot, props=MappingProxyType(by_name))


def _exclude_base_contacts(arena: KitchenArena, robot: Franka) -> None:
    """Spares MuJoCo the search for contacts between the robot's base and its first link.

    They are 1 mm apart at every angle of the joint between them. Of neighbours MuJoCo leaves out all others by itself,
    but not those of a body that is fixed to the world.
    """
    base, first = (robot.mjcf_model.find("body", name) for name in ("link0", "link1"))
    arena.mjcf_model.contact.add("exclude", name="base_and_first_link", body1=base, body2=first)

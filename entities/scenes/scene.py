"""Scenes of an arena, a robot and props."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Self

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.joints import position_sizes
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.props.prop import Prop
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.scenes.arena import SiteArena


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """A robot and props in an arena; the positions of the props' joints, end to end, are the object positions.

    Attributes:
      arena: the arena, with everything else attached to it.
      robot: the Franka.
      props: the objects by name, in the order in which their joints are observed.
    """

    arena: SiteArena
    robot: Franka
    props: Mapping[str, Prop]

    @classmethod
    def furnish(cls, arena: SiteArena, robot: Franka, props: Iterable[Prop]) -> Self:
        """Attaches a robot and props, in the order of observation, at the arena's sites of their names.

        Raises:
          ValueError: the arena lacks a site.
        """
        by_name = {prop.mjcf_model.model: prop for prop in props}
        arena.attach_at_site(robot)
        for prop in by_name.values():
            arena.attach_at_site(prop, free=prop.free)
        return cls(arena=arena, robot=robot, props=MappingProxyType(by_name))

    def prepare_appearance(self) -> None:
        """Adds the textures from which a reset may choose; to be called before the scene is compiled.

        Physics and images stay the same to the bit until one is chosen.
        """
        self.arena.prepare_appearance()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of arena, robot and props."""
        entities = (self.arena, self.robot, *self.props.values())
        return tuple(parameter for entity in entities for parameter in entity.parameters)

    @property
    def object_joints(self) -> tuple[mjcf.Element, ...]:
        """The joints of all props, in the order of observation."""
        return tuple(joint for prop in self.props.values() for joint in prop.joints)

    def joints(self, prop: str, names: Sequence[str] | None = None) -> tuple[mjcf.Element, ...]:
        """Returns joints of a prop.

        Args:
          prop: name of the prop.
          names: names of the joints in the prop's own model; all of them when omitted.

        Raises:
          ValueError: an unknown name.
        """
        joints = self.props[checks.choice(prop, self.props, "prop")].joints
        if names is None:
            return joints
        by_name = {joint.name: joint for joint in joints}
        return tuple(by_name[checks.choice(name, by_name, f"joint of {prop!r}")] for name in names)

    def elements(self, prop: str, names: Sequence[str] | None = None) -> NDArray[np.int64]:
        """Returns the indices `(k,)` of the positions of some joints among the object positions; see `joints`."""
        observed, wanted = self.object_joints, self.joints(prop, names)
        elements = np.split(np.arange(sum(position_sizes(observed))), np.cumsum(position_sizes(observed))[:-1])
        by_joint = dict(zip(observed, elements, strict=True))
        return np.concatenate([by_joint[joint] for joint in wanted])

"""The cabinet's room, and the scene of the open_cabinet domain put together: room, robot and cabinet."""

import dataclasses

from dm_control import composer, mjcf

from kitchen_suite.entities import assets
from kitchen_suite.entities.props.cabinet import Cabinet
from kitchen_suite.entities.props.cabinet_config import CabinetConfig
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.robots.panda import PANDA


class OpenCabinetArena(composer.Arena):
    """Floor, walls, lights, cameras, and the places of robot and cabinet."""

    def _build(self, *, visuals: bool = True, name: str = "room") -> None:
        """Reads the room's MJCF.

        Args:
          visuals: `False` leaves out what only the eye needs; the physics stays the same to the bit.
          name: name of the model.
        """
        self._mjcf_root = assets.load_mjcf("cabinet_arena", visuals=visuals)
        self._mjcf_root.model = name

    @property
    def robot_site(self) -> mjcf.Element:
        """Where the robot stands, facing -x."""
        return self._mjcf_root.find("site", "franka")

    @property
    def cabinet_site(self) -> mjcf.Element:
        """Where the cabinet's middle is, its front facing +x."""
        return self._mjcf_root.find("site", "cabinet")


@dataclasses.dataclass(frozen=True, kw_only=True)
class OpenCabinetScene:
    """A robot before a cabinet.

    Attributes:
      arena: the room, which everything else is attached to.
      robot: the Panda, in its own joint convention.
      cabinet: what it opens.
    """

    arena: OpenCabinetArena
    robot: Franka
    cabinet: Cabinet


def build_open_cabinet_scene(config: CabinetConfig | None = None, *, visuals: bool = True) -> OpenCabinetScene:
    """Puts the scene of the open_cabinet domain together.

    Args:
      config: sizes and resistances of the cabinet; the default config when omitted.
      visuals: `False` leaves out all geoms that only the eye needs, which is faster; trajectories are the same to the
        bit.
    """
    arena = OpenCabinetArena(visuals=visuals)
    robot = Franka(PANDA, visuals=visuals)
    cabinet = Cabinet(config, visuals=visuals)
    arena.attach(robot, arena.robot_site)
    arena.attach(cabinet, arena.cabinet_site)
    return OpenCabinetScene(arena=arena, robot=robot, cabinet=cabinet)

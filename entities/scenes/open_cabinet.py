"""The arena and the scene of the open_cabinet domain: arena, robot and cabinet."""

import dataclasses

from kitchen_suite.entities.props.cabinet import Cabinet
from kitchen_suite.entities.props.cabinet_config import CabinetConfig
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.robots.panda import PANDA
from kitchen_suite.entities.scenes.arena import SiteArena


class OpenCabinetArena(SiteArena):
    """Floor, walls, lights, cameras, a site for the robot, facing -x, and one for the cabinet's centre, facing +x."""

    xml_name = "cabinet_arena"
    default_name = "room"


@dataclasses.dataclass(frozen=True, kw_only=True)
class OpenCabinetScene:
    """A robot in front of a cabinet.

    Attributes:
      arena: the arena, with everything else attached to it.
      robot: the Panda, in its own joint convention.
      cabinet: the cabinet with the drawers to open.
    """

    arena: OpenCabinetArena
    robot: Franka
    cabinet: Cabinet


def build_open_cabinet_scene(config: CabinetConfig | None = None, *, visuals: bool = True) -> OpenCabinetScene:
    """Builds the scene of the open_cabinet domain.

    Args:
      config: sizes and resistances of the cabinet; the default config when omitted.
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    arena = OpenCabinetArena(visuals=visuals)
    robot = Franka(PANDA, visuals=visuals)
    cabinet = Cabinet(config, visuals=visuals)
    arena.attach_at_site(robot)
    arena.attach_at_site(cabinet)
    return OpenCabinetScene(arena=arena, robot=robot, cabinet=cabinet)

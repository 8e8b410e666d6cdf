"""The arena and the scene of the open_cabinet domain: arena, robot and cabinet."""

from kitchen_suite.entities import surfaces
from kitchen_suite.entities.props.cabinet import Cabinet
from kitchen_suite.entities.props.cabinet_config import CabinetConfig
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.robots.panda import PANDA
from kitchen_suite.entities.scenes.arena import SiteArena
from kitchen_suite.entities.scenes.scene import Scene


class OpenCabinetArena(SiteArena):
    """Floor, walls, lights, cameras, a site for the robot, facing -x, and one for the cabinet's centre, facing +x."""

    xml_name = "cabinet_arena"
    default_name = "room"
    surfaces = surfaces.OPEN_CABINET


class OpenCabinetScene(Scene):
    """The Panda, in its own joint convention, in front of a cabinet."""

    @property
    def cabinet(self) -> Cabinet:
        """The cabinet with the drawers to open."""
        cabinet = self.props["cabinet"]
        assert isinstance(cabinet, Cabinet)
        return cabinet


def build_open_cabinet_scene(config: CabinetConfig | None = None, *, visuals: bool = True) -> OpenCabinetScene:
    """Builds the scene of the open_cabinet domain.

    Args:
      config: sizes and resistances of the cabinet; the default config when omitted.
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    arena, robot = OpenCabinetArena(visuals=visuals), Franka(PANDA, visuals=visuals)
    return OpenCabinetScene.furnish(arena, robot, [Cabinet(config, visuals=visuals)])

"""The arena and the scene of the microwave_table domain: arena, robot and a microwave on a table."""

from kitchen_suite.entities import surfaces
from kitchen_suite.entities.props.kitchen import Microwave
from kitchen_suite.entities.robots.franka import Franka
from kitchen_suite.entities.robots.panda import PANDA
from kitchen_suite.entities.scenes.arena import SiteArena
from kitchen_suite.entities.scenes.scene import Scene


class MicrowaveTableArena(SiteArena):
    """Floor, wall, lights, cameras, pedestal, table, and a site for the robot and for the microwave, face to face."""

    xml_name = "microwave_table_arena"
    default_name = "room"
    surfaces = surfaces.MICROWAVE_TABLE


def build_microwave_table_scene(*, visuals: bool = True) -> Scene:
    """Builds the scene of the microwave_table domain: the Panda, in its own joint convention, before the microwave.

    Args:
      visuals: `False` leaves out the visual geoms, which is faster; trajectories are the same to the bit.
    """
    arena, robot = MicrowaveTableArena(visuals=visuals), Franka(PANDA, visuals=visuals)
    return Scene.furnish(arena, robot, [Microwave(visuals=visuals)])

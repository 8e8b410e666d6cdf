"""A domain of one's own: the Panda pushes a lever on a table. Run: python my_domain.py."""

import numpy as np

from kitchen_suite.entities import MicrowaveTableArena, Prop, Scene, make_robot

# isort: split
# After the suite: imported first, dm_control would look for a display.
from dm_control import mjcf

HOME = np.array([0.0, -0.6, 0.0, -2.4, 0.0, 1.9, 0.8, 0.02, 0.02])  # Of the arm's joints [rad] and the fingers [m].
GOAL = 0.5  # Angle from which the lever counts as pushed [rad].


class Lever(Prop):
    """A lever of 0.2 kg that stands upright, with a spring."""

    def _build(self):
        self._mjcf_root = mjcf.RootElement(model="lever")
        arm = self._mjcf_root.worldbody.add("body", name="arm")
        arm.add("joint", name="hinge", axis=(0, 1, 0), range=(-1.2, 1.2), stiffness=0.5, damping=0.05)
        arm.add("geom", type="capsule", size=(0.012,), fromto=(0, 0, 0.03, 0, 0, 0.15), mass=0.2, rgba=(0.8, 0.5, 0, 1))
        arm.add("site", name="tip", pos=(0, 0, 0.15))

    @property
    def joints(self):
        return (self._mjcf_root.find("joint", "hinge"),)


def build_lever_scene(*, visuals=True):
    """Builds the room of the microwave_table domain, with a lever in place of the microwave."""
    arena = MicrowaveTableArena(visuals=visuals)
    arena.mjcf_model.find("site", "microwave").name = "lever"
    return Scene.furnish(arena, make_robot("panda_table", visuals=visuals), [Lever()])

"""What a reset of the open_cabinet domain may draw anew: where the cabinet stands, and what resists the robot."""

import dataclasses
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.composer import variation
from dm_control.composer.variation import distributions

from kitchen_suite.entities import CabinetScene

# A composer variation or a constant.
Variation = Any


@dataclasses.dataclass(frozen=True, kw_only=True)
class Randomization:
    """What is drawn at every reset; each a composer variation, a constant, or `None` for the scene as it was built.

    Attributes:
      cabinet_offset: `(3,)`, from the cabinet's place, along the world's axes [m].
      cabinet_yaw: turn of the cabinet about the vertical [rad].
      drawer_friction: dry friction of the drawer's slides [N].
      drawer_damping: [N s/m].
      pad_friction: coefficient of sliding friction of the finger pads; contact takes the greater one of pad and bar.
    """

    cabinet_offset: Variation | None = None
    cabinet_yaw: Variation | None = None
    drawer_friction: Variation | None = None
    drawer_damping: Variation | None = None
    pad_friction: Variation | None = None


# A few centimetres and degrees, and resistances within about a third of the built ones.
MODERATE = Randomization(
    cabinet_offset=distributions.Uniform(low=(-0.03, -0.05, 0.0), high=(0.03, 0.05, 0.0)),
    cabinet_yaw=distributions.Uniform(low=-0.1, high=0.1),
    drawer_friction=distributions.Uniform(low=2.5, high=4.0),
    drawer_damping=distributions.Uniform(low=10.0, high=20.0),
    pad_friction=distributions.Uniform(low=1.2, high=1.8),
)


class Randomizer:
    """Applies a `Randomization` to a compiled scene; draws nothing for what is `None`."""

    def __init__(self, scene: CabinetScene, drawer: str, randomization: Randomization, physics: mjcf.Physics) -> None:
        """Notes where the cabinet was built; to be called before anything has been drawn."""
        self._cabinet = scene.cabinet
        self._randomization = randomization
        self._place = np.array(physics.bind(mjcf.get_attachment_frame(scene.cabinet.mjcf_model)).pos)
        self._slide = scene.cabinet.drawer_joint(drawer)
        self._pads = [scene.robot.mjcf_model.find("geom", f"{side}_finger_pad") for side in ("left", "right")]

    def apply(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Draws and sets everything, in the order of `Randomization`'s attributes."""
        drawn = {
            field.name: variation.evaluate(wanted, random_state=random_state)
            for field in dataclasses.fields(self._randomization)
            if (wanted := getattr(self._randomization, field.name)) is not None
        }
        if "cabinet_offset" in drawn:
            self._cabinet.set_pose(physics, position=self._place + drawn["cabinet_offset"])
        if "cabinet_yaw" in drawn:
            half = 0.5 * drawn["cabinet_yaw"]
            self._cabinet.set_pose(physics, quaternion=(np.cos(half), 0.0, 0.0, np.sin(half)))
        if "drawer_friction" in drawn:
            physics.bind(self._slide).frictionloss = drawn["drawer_friction"]
        if "drawer_damping" in drawn:
            physics.bind(self._slide).damping = drawn["drawer_damping"]
        if "pad_friction" in drawn:
            for pad in self._pads:
                physics.bind(pad).friction[0] = drawn["pad_friction"]

"""Domain randomization of open_cabinet: cabinet pose, drawer resistance and pad friction, drawn at resets."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from dm_control.composer.variation import distributions

from kitchen_suite import checks
from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.entities import parameters as kinds
from kitchen_suite.entities.parameters import Parameter, Quantity
from kitchen_suite.tasks import variations
from kitchen_suite.tasks.variations import Variation

# Kinds of the parameters by attribute of `Randomization`, in the order in which they are drawn.
QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "cabinet_offset": kinds.POSITION_OFFSET,
        "cabinet_yaw": kinds.YAW,
        "drawer_friction": kinds.JOINT_FRICTION,
        "drawer_damping": kinds.JOINT_DAMPING,
        "pad_friction": kinds.SLIDING_FRICTION,
    }
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Randomization:
    """Parameters of the scene that are drawn at every reset.

    Each is a composer variation, a constant, or `None` for the scene as it was built. Constants are checked at once,
    values of variations at each reset. Friction and damping must not be negative.

    Attributes:
      cabinet_offset: `(3,)`, translation of the cabinet from its built position, in the world frame [m].
      cabinet_yaw: rotation of the cabinet about the vertical [rad].
      drawer_friction: dry friction of the drawer's slides [N].
      drawer_damping: damping of the drawer's slides [N s/m].
      pad_friction: coefficient of sliding friction of the finger pads; a contact has the greater one of pad and bar.
    """

    cabinet_offset: Variation | None = None
    cabinet_yaw: Variation | None = None
    drawer_friction: Variation | None = None
    drawer_damping: Variation | None = None
    pad_friction: Variation | None = None

    def __post_init__(self) -> None:
        variations.check_constants(self.by_name, QUANTITIES, "randomization")

    @classmethod
    def make(cls, value: object) -> "Randomization":
        """Returns the randomization that an argument of an environment describes.

        Args:
          value: a `Randomization`, None for no randomization, a key of `PRESETS`, or variations by attribute, where
            JSON may describe distributions (see `variations.parse`).

        Raises:
          TypeError: it is something else, or a number is of the wrong type.
          ValueError: an unknown preset, attribute or distribution, or a number out of range.
        """
        if isinstance(value, cls):
            return value
        if isinstance(value, str):
            return PRESETS[checks.choice(value, PRESETS.keys(), "randomization")]
        if not isinstance(value, Mapping | None):
            raise TypeError(f"randomization must be a Randomization, a dict or the name of a preset, got {value!r}")
        wanted = value or {}
        for name in wanted:
            checks.choice(name, QUANTITIES.keys(), "randomization's parameter")
        parsed = {name: variations.parse(wanted[name], QUANTITIES[name], f"randomization's {name}") for name in wanted}
        return cls(**parsed)

    @property
    def by_name(self) -> dict[str, Any]:
        """The variations by attribute."""
        return {name: getattr(self, name) for name in QUANTITIES}


# A few centimetres and degrees, and resistances within about a third of the default ones.
MODERATE = Randomization(
    cabinet_offset=distributions.Uniform(low=(-0.03, -0.05, 0.0), high=(0.03, 0.05, 0.0)),
    cabinet_yaw=distributions.Uniform(low=-0.1, high=0.1),
    drawer_friction=distributions.Uniform(low=2.5, high=4.0),
    drawer_damping=distributions.Uniform(low=10.0, high=20.0),
    pad_friction=distributions.Uniform(low=1.2, high=1.8),
)

PRESETS: Mapping[str, Randomization] = MappingProxyType({"moderate": MODERATE})


def scene_parameters(scene: OpenCabinetScene, drawer: str) -> dict[str, Parameter]:
    """Returns the parameters of a scene whose `top` or `bottom` drawer is to be opened, as `QUANTITIES` orders them."""
    offered = {parameter.name: parameter for parameter in (*scene.cabinet.parameters, *scene.robot.parameters)}
    cabinet, robot = scene.cabinet.mjcf_model.model, scene.robot.mjcf_model.model
    names = {
        "cabinet_offset": f"{cabinet}/offset",
        "cabinet_yaw": f"{cabinet}/yaw",
        "drawer_friction": f"{cabinet}/drawer_{drawer}_friction",
        "drawer_damping": f"{cabinet}/drawer_{drawer}_damping",
        "pad_friction": f"{robot}/pad_friction",
    }
    return {name: offered[names[name]] for name in QUANTITIES}

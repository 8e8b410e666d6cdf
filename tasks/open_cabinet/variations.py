"""Variations of the parameters of open_cabinet by groups, in the order in which they are drawn."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from dm_control.composer.variation.distributions import Uniform

from kitchen_suite import checks
from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.entities import parameters as kinds
from kitchen_suite.entities.cabinet import DOORS, DRAWERS
from kitchen_suite.entities.parameters import ParameterType
from kitchen_suite.tasks.pushes import PUSH
from kitchen_suite.tasks.variations import appearance, distributions
from kitchen_suite.tasks.variations.distributions import ParameterVariation, Variation, around, between, one_of
from kitchen_suite.tasks.variations.randomizer import Draw

# The robot's own pose is drawn at every reset, whatever varies.
START = (
    *(between(f"cabinet/drawer_{drawer}", "start", seen=(0.0, 0.04), held_out=[(0.04, 0.08)]) for drawer in DRAWERS),
    *(between(f"cabinet/door_{door}", "start", seen=(0.0, 0.2), held_out=[(0.2, 0.4)]) for door in DOORS),
)

# Pose of the cabinet on the floor [m, rad]; those seen are the ones of the randomization `moderate`.
LAYOUT = (
    around("cabinet/offset", "layout", seen=(0.03, 0.05, 0.0), held_out=(0.035, 0.06, 0.0)),
    around("cabinet/yaw", "layout", seen=0.1, held_out=0.115),
)

# The seen values of cabinet and pads are those of the preset `moderate` of `Randomization`.
DYNAMICS = (
    around("franka/gain_scale", "dynamics", seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", seen=0.1, held_out=0.2),
    *(
        varied
        for drawer in ("cabinet/drawer_top", "cabinet/drawer_bottom")
        for varied in (
            between(f"{drawer}_friction", "dynamics", seen=(2.5, 4.0), held_out=[(2.0, 2.5), (4.0, 4.5)]),
            between(f"{drawer}_damping", "dynamics", seen=(10.0, 20.0), held_out=[(7.0, 10.0), (20.0, 23.0)]),
        )
    ),
    between("franka/pad_friction", "dynamics", seen=(1.2, 1.8), held_out=[(1.1, 1.2), (1.8, 2.0)]),
)

SENSING = (
    between("sensing/noise", "sensing", seen=(0.5, 2.0), held_out=[(2.0, 3.0)]),
    one_of("sensing/action_delay", "sensing", seen=(0.0, 1.0), held_out=(1.0,)),
)

APPEARANCE = (
    *appearance.ROOM,
    appearance.color("cabinet/front_", appearance.LACQUER),
    appearance.texture("cabinet/front_", seen=(0, 1, 2), held_out=(3, 4)),
    appearance.color("cabinet/carcass_", appearance.PAINT),
    appearance.color("cabinet/tray_", appearance.TINT),
    appearance.color("cabinet/worktop_", appearance.TINT),
    appearance.texture("cabinet/worktop_", seen=(0, 1), held_out=(2, 3)),
    appearance.color("cabinet/handle_", appearance.METAL),
)

CAMERA = appearance.cameras("overview", "handle", "franka/wrist", "franka/hand")

VARIED: tuple[ParameterVariation, ...] = (*START, *LAYOUT, *DYNAMICS, *SENSING, *APPEARANCE, *CAMERA, *PUSH)


# Kind and name of the parameter of each attribute of `Randomization`, in the order in which they are drawn.
_PARAMETERS: Mapping[str, tuple[ParameterType, str]] = {
    "cabinet_offset": (kinds.POSITION_OFFSET, "{cabinet}/offset"),
    "cabinet_yaw": (kinds.YAW, "{cabinet}/yaw"),
    "drawer_friction": (kinds.JOINT_FRICTION, "{cabinet}/drawer_{drawer}_friction"),
    "drawer_damping": (kinds.JOINT_DAMPING, "{cabinet}/drawer_{drawer}_damping"),
    "pad_friction": (kinds.SLIDING_FRICTION, "{robot}/pad_friction"),
}


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
        for name, each in self.by_name.items():
            distributions.draws_fit(each, _PARAMETERS[name][0], f"randomization's {name}")

    @classmethod
    def make(cls, value: object) -> "Randomization":
        """Returns the randomization that an argument of an environment describes.

        Args:
          value: a `Randomization`, None for no randomization, a key of `PRESETS`, or variations by attribute, where
            JSON may describe distributions (see `distributions.parse`).

        Raises:
          TypeError: it is something else, or a number is of the wrong type.
          ValueError: an unknown preset, attribute or distribution, or a number out of range.
        """
        if isinstance(value, cls):
            return value
        if isinstance(value, str):
            return PRESETS[checks.choice(value, PRESETS.keys(), "randomization")]
        if not isinstance(value, Mapping | None):
            raise TypeError(
                f"randomization must be a Randomization, a dict or the name of a preset, got {checks.shown(value)}"
            )
        parsed = {}
        for name, each in (value or {}).items():
            kind, _ = _PARAMETERS[checks.choice(name, _PARAMETERS.keys(), "randomization's parameter")]
            parsed[name] = distributions.parse(each, kind, f"randomization's {name}")
        return cls(**parsed)

    @property
    def by_name(self) -> dict[str, Any]:
        """The variations by attribute; those that are None are left out."""
        return {name: getattr(self, name) for name in _PARAMETERS if getattr(self, name) is not None}

    def draws(self, scene: OpenCabinetScene, drawer: str) -> dict[str, Draw]:
        """Returns what a reset draws by attribute, in a scene whose `top` or `bottom` drawer is to be opened."""
        offered = {parameter.name: parameter for parameter in (*scene.cabinet.parameters, *scene.robot.parameters)}
        owners = {"cabinet": scene.cabinet.mjcf_model.model, "robot": scene.robot.mjcf_model.model, "drawer": drawer}
        draws = {}
        for name, each in self.by_name.items():
            parameter = offered[_PARAMETERS[name][1].format(**owners)]
            draws[name] = Draw(parameter=parameter, variation=each, label=f"randomization's {name}")
        return draws


# A few centimetres and degrees, and resistances within about a third of the default ones.
MODERATE = Randomization(
    cabinet_offset=Uniform(low=(-0.03, -0.05, 0.0), high=(0.03, 0.05, 0.0)),
    cabinet_yaw=Uniform(low=-0.1, high=0.1),
    drawer_friction=Uniform(low=2.5, high=4.0),
    drawer_damping=Uniform(low=10.0, high=20.0),
    pad_friction=Uniform(low=1.2, high=1.8),
)

PRESETS: Mapping[str, Randomization] = MappingProxyType({"moderate": MODERATE})

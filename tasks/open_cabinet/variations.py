"""Variations of the parameters of open_cabinet by groups, in the order in which they are drawn."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from dm_control.composer.variation import distributions

from kitchen_suite import checks
from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.entities import parameters as kinds
from kitchen_suite.entities.cabinet import DOORS, DRAWERS
from kitchen_suite.entities.parameters import Parameter, Quantity
from kitchen_suite.tasks.variations import appearance as looks
from kitchen_suite.tasks.variations import distributions as variations
from kitchen_suite.tasks.variations.distributions import Variation, Varied, around, between, one_of

# The robot's own pose is drawn at every reset, whatever varies.
START = (
    *(
        between(f"cabinet/drawer_{drawer}", "start", default=0.0, seen=(0.0, 0.04), held_out=[(0.04, 0.08)])
        for drawer in DRAWERS
    ),
    *(between(f"cabinet/door_{door}", "start", default=0.0, seen=(0.0, 0.2), held_out=[(0.2, 0.4)]) for door in DOORS),
)

# Pose of the cabinet on the floor [m, rad]; those seen are the ones of the randomization `moderate`.
LAYOUT = (
    around("cabinet/offset", "layout", default=(0.0, 0.0, 0.0), seen=(0.03, 0.05, 0.0), held_out=(0.035, 0.06, 0.0)),
    around("cabinet/yaw", "layout", seen=0.1, held_out=0.115),
)

# The seen values of cabinet and pads are those of the preset `moderate` of `Randomization`.
DYNAMICS = (
    around("franka/gain_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    *(
        varied
        for drawer in DRAWERS
        for varied in (
            between(
                f"cabinet/drawer_{drawer}_friction",
                "dynamics",
                default=3.0,
                seen=(2.5, 4.0),
                held_out=[(2.0, 2.5), (4.0, 4.5)],
            ),
            between(
                f"cabinet/drawer_{drawer}_damping",
                "dynamics",
                default=15.0,
                seen=(10.0, 20.0),
                held_out=[(7.0, 10.0), (20.0, 23.0)],
            ),
        )
    ),
    between("franka/pad_friction", "dynamics", default=1.5, seen=(1.2, 1.8), held_out=[(1.1, 1.2), (1.8, 2.0)]),
)

SENSING = (
    between("sensing/noise", "sensing", default=1.0, seen=(0.5, 2.0), held_out=[(2.0, 3.0)]),
    one_of("sensing/action_delay", "sensing", default=0.0, seen=(0.0, 1.0), held_out=(1.0,)),
)

APPEARANCE = (
    *looks.ROOM,
    looks.color("walls/", looks.PAINT, default=(0.88, 0.86, 0.82)),
    looks.texture("walls/", seen=(0, 1, 2), held_out=(3, 4)),
    looks.color("cabinet/front_", looks.LACQUER, default=(0.36, 0.47, 0.53)),
    looks.texture("cabinet/front_", seen=(0, 1, 2), held_out=(3, 4)),
    looks.color("cabinet/carcass_", looks.PAINT, default=(0.80, 0.79, 0.76)),
    looks.color("cabinet/tray_", looks.TINT, default=(0.72, 0.58, 0.42)),
    looks.color("cabinet/worktop_", looks.TINT, default=(1, 1, 1)),
    looks.texture("cabinet/worktop_", seen=(0, 1), held_out=(2, 3)),
    looks.color("cabinet/handle_", looks.METAL, default=(0.80, 0.80, 0.82)),
)

CAMERA = looks.cameras({"overview": 40, "handle": 42, "franka/wrist": 75, "franka/hand": 80})

VARIED: tuple[Varied, ...] = (*START, *LAYOUT, *DYNAMICS, *SENSING, *APPEARANCE, *CAMERA)


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

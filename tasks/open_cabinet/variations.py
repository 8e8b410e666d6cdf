"""Variations of the parameters of open_cabinet by groups, in the order in which they are drawn."""

from kitchen_suite.entities.cabinet import DOORS, DRAWERS
from kitchen_suite.tasks.episode.pushes import PUSH
from kitchen_suite.tasks.variations import appearance
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, between, one_of

# The robot's own pose is drawn at every reset, whatever varies.
START = (
    *(between(f"cabinet/drawer_{drawer}", "start", seen=(0.0, 0.04), held_out=[(0.04, 0.08)]) for drawer in DRAWERS),
    *(between(f"cabinet/door_{door}", "start", seen=(0.0, 0.2), held_out=[(0.2, 0.4)]) for door in DOORS),
)

# Pose of the cabinet on the floor [m, rad]: those seen are within a few centimetres and degrees of the built one.
LAYOUT = (
    around("cabinet/offset", "layout", seen=(0.03, 0.05, 0.0), held_out=(0.035, 0.06, 0.0)),
    around("cabinet/yaw", "layout", seen=0.1, held_out=0.115),
)

# The seen resistances of drawers and pads are within about a third of the default ones.
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

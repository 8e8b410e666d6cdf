"""Variations of the parameters of open_cabinet by groups, in the order in which they are drawn."""

from kitchen_suite.entities.props.cabinet import DOORS, DRAWERS
from kitchen_suite.tasks import appearance as looks
from kitchen_suite.tasks.varied import Varied, around, between, one_of

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

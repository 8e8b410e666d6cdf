"""The parameters of the open_cabinet domain that groups of variations vary, with seen and held-out distributions."""

from kitchen_suite.entities.props.cabinet import DOORS, DRAWERS
from kitchen_suite.tasks.varied import Varied, around, between, one_of

# The robot's own pose is drawn at every reset, whatever varies.
START = (
    *(
        between(f"cabinet/drawer_{drawer}", "start", default=0.0, seen=(0.0, 0.04), held_out=[(0.04, 0.08)])
        for drawer in DRAWERS
    ),
    *(between(f"cabinet/door_{door}", "start", default=0.0, seen=(0.0, 0.2), held_out=[(0.2, 0.4)]) for door in DOORS),
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

VARIED: tuple[Varied, ...] = (*START, *DYNAMICS, *SENSING)

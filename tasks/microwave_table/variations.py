"""The parameters of the microwave_table domain that groups of variations vary, with seen and held-out distributions."""

import numpy as np

from kitchen_suite.tasks.varied import Varied, around, between, one_of

START = (
    around("franka/joint_offset", "start", default=np.zeros(7), seen=0.05, held_out=0.1),
    between("microwave/door", "start", default=0.0, seen=(-0.2, 0.0), held_out=[(-0.35, -0.2)]),
)

DYNAMICS = (
    around("franka/gain_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("microwave/damping_scale", "dynamics", default=1.0, seen=0.3, held_out=0.5),
    around("microwave/friction_scale", "dynamics", default=1.0, seen=0.3, held_out=0.5),
)

SENSING = (one_of("sensing/action_delay", "sensing", default=0.0, seen=(0.0, 1.0), held_out=(1.0,)),)

VARIED: tuple[Varied, ...] = (*START, *DYNAMICS, *SENSING)

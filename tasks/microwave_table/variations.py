"""Variations of the parameters of microwave_table by groups, in the order in which they are drawn."""

import math

import numpy as np

from kitchen_suite.tasks import appearance as looks
from kitchen_suite.tasks.varied import Varied, around, between, one_of

START = (
    around("franka/joint_offset", "start", default=np.zeros(7), seen=0.05, held_out=0.1),
    between("microwave/door", "start", default=0.0, seen=(-0.2, 0.0), held_out=[(-0.35, -0.2)]),
)

# Pose of the microwave on the table [m, rad].
LAYOUT = (
    around("microwave/offset", "layout", default=(0.0, 0.0, 0.0), seen=(0.03, 0.05, 0.0), held_out=(0.05, 0.08, 0.0)),
    around("microwave/yaw", "layout", default=-math.pi / 2, seen=0.1, held_out=0.15),
)

DYNAMICS = (
    around("franka/gain_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", default=1.0, seen=0.1, held_out=0.2),
    around("microwave/damping_scale", "dynamics", default=1.0, seen=0.3, held_out=0.5),
    around("microwave/friction_scale", "dynamics", default=1.0, seen=0.3, held_out=0.5),
)

SENSING = (one_of("sensing/action_delay", "sensing", default=0.0, seen=(0.0, 1.0), held_out=(1.0,)),)

APPEARANCE = (
    *looks.ROOM,
    looks.color("walls/", looks.PAINT, default=(0.88, 0.86, 0.82)),
    looks.texture("walls/", seen=(0, 1, 2), held_out=(3, 4)),
    looks.color("table/", looks.TINT, default=(1, 1, 1)),
    looks.texture("table/", seen=(0, 1), held_out=(2, 3)),
    looks.color("table/leg_", looks.LACQUER, default=(0.36, 0.47, 0.53)),
    looks.color("pedestal/", looks.GREY, default=(0.55, 0.56, 0.58)),
    *looks.MICROWAVE,
)

CAMERA = looks.cameras({"overview": 40, "left": 44, "right": 44, "franka/wrist": 75, "franka/hand": 80})

VARIED: tuple[Varied, ...] = (*START, *LAYOUT, *DYNAMICS, *SENSING, *APPEARANCE, *CAMERA)

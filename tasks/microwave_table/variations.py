"""Groups of variations of microwave_table: how they vary the parameters of its scene."""

import math

from kitchen_suite.tasks.varied import Varied, around

# Pose of the microwave on the table [m, rad].
LAYOUT: tuple[Varied, ...] = (
    around("microwave/offset", "layout", default=(0.0, 0.0, 0.0), seen=(0.03, 0.05, 0.0), held_out=(0.05, 0.08, 0.0)),
    around("microwave/yaw", "layout", default=-math.pi / 2, seen=0.1, held_out=0.15),
)

"""How the groups of variations of microwave_table vary its parameters, in the order in which they are drawn."""

from kitchen_suite.tasks import appearance as looks

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

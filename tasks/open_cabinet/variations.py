"""How the groups of variations of open_cabinet vary its parameters, in the order in which they are drawn."""

from kitchen_suite.tasks import appearance as looks

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

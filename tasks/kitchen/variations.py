"""How the kitchen's groups of variations vary its parameters, in the order in which they are drawn."""

from kitchen_suite.tasks import appearance as looks

APPEARANCE = (
    *looks.ROOM,
    looks.color("walls/", looks.PAINT, default=(0.66, 0.7, 0.8)),
    looks.texture("walls/", seen=(0, 1, 2), held_out=(3, 4)),
    looks.color("walls/base_board_", looks.TINT, default=(1, 1, 1)),
    looks.color("counter/", looks.TINT, default=(1, 1, 1)),
    looks.texture("counter/", seen=(0, 1, 2), held_out=(3, 4)),
    looks.color("cabinets/", looks.LACQUER, default=(0.46, 0.5, 0.6)),
    looks.texture("cabinets/", seen=(0, 1, 2), held_out=(3, 4)),
    looks.color("handles/", looks.METAL, default=(1, 1, 1)),
    looks.color("oven/metal_", looks.METAL, default=(1, 1, 1)),
    looks.color("oven/enamel_", looks.HOB, default=(0.15, 0.15, 0.15)),
    looks.brightness("oven/hob_light_", seen=(0.5, 1.0), held_out=((0.0, 0.5), (1.0, 1.3))),
    *looks.MICROWAVE,
    looks.color("kettle/", looks.KETTLE, default=(0.9, 0.9, 0.9)),
    looks.color("kettle/grip_", looks.TINT, default=(1, 1, 1)),
    looks.texture("kettle/grip_", seen=(0, 1), held_out=(2, 3)),
    looks.color("pedestal/", looks.GREY, default=(0.5, 0.5, 0.5)),
)

CAMERA = looks.cameras(
    {"overview": 45, "workspace": 51, "left": 45, "right": 45, "franka/wrist": 75, "franka/hand": 80}
)

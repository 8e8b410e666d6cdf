"""The variations of the microwave_table domain."""

from kitchen_suite.tasks.episode.pushes import PUSH
from kitchen_suite.tasks.variations import appearance
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, between, one_of

START = (
    around("franka/joint_offset", "start", seen=0.05, held_out=0.1),
    between("microwave/door", "start", seen=(-0.2, 0.0), held_out=[(-0.35, -0.2)]),
)

# Pose of the microwave on the table [m, rad].
LAYOUT = (
    around("microwave/offset", "layout", seen=(0.03, 0.05, 0.0), held_out=(0.05, 0.08, 0.0)),
    around("microwave/yaw", "layout", seen=0.1, held_out=0.15),
)

DYNAMICS = (
    around("franka/gain_scale", "dynamics", seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", seen=0.1, held_out=0.2),
    around("microwave/damping_scale", "dynamics", seen=0.3, held_out=0.5),
    around("microwave/friction_scale", "dynamics", seen=0.3, held_out=0.5),
)

SENSING = (one_of("sensing/action_delay", "sensing", seen=(0.0, 1.0), held_out=(1.0,)),)

APPEARANCE = (
    *appearance.ROOM,
    appearance.color("table/", appearance.TINT),
    appearance.texture("table/", seen=(0, 1), held_out=(2, 3)),
    appearance.color("table/leg_", appearance.LACQUER),
    appearance.color("pedestal/", appearance.GREY),
    *appearance.MICROWAVE,
)

CAMERA = appearance.cameras("overview", "left", "right", "franka/wrist", "franka/hand")

VARIED: tuple[ParameterVariation, ...] = (*START, *LAYOUT, *DYNAMICS, *SENSING, *APPEARANCE, *CAMERA, *PUSH)

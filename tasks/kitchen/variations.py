"""Groups of variations of the kitchen: how they vary the parameters of its scene."""

from kitchen_suite.tasks.varied import Varied, around, between, one_of

# Poses of the furniture and of the robot's base [m, rad], and the burner of the kettle.
# The cabinets stand on the hood and reach into the wall behind them: they can be raised and brought forward, and the
# hood can be lowered. The robot's pedestal stands against the oven, so that it can only be moved back.
LAYOUT: tuple[Varied, ...] = (
    between(
        "pedestal/offset",
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((-0.02, -0.02, 0.0), (0.02, 0.0, 0.0)),
        held_out=[((-0.03, -0.03, 0.0), (-0.02, -0.02, 0.0)), ((0.02, -0.03, 0.0), (0.03, -0.02, 0.0))],
    ),
    around("microwave/offset", "layout", default=(0.0, 0.0, 0.0), seen=(0.03, 0.03, 0.0), held_out=(0.04, 0.04, 0.0)),
    around("microwave/yaw", "layout", default=0.3, seen=0.08, held_out=0.12),
    between(
        "slide_cabinet/offset",
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((-0.02, -0.02, 0.0), (0.02, 0.0, 0.03)),
        held_out=[((-0.03, -0.03, 0.03), (-0.02, -0.02, 0.04)), ((0.02, -0.03, 0.03), (0.03, -0.02, 0.04))],
    ),
    between(
        "hinge_cabinet/offset",
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((-0.02, -0.02, 0.0), (0.02, 0.0, 0.03)),
        held_out=[((-0.03, -0.03, 0.03), (-0.02, -0.02, 0.04)), ((0.02, -0.03, 0.03), (0.03, -0.02, 0.04))],
    ),
    between(
        "hood/offset",
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((0.0, 0.0, -0.03), (0.0, 0.0, 0.0)),
        held_out=[((0.0, 0.0, -0.05), (0.0, 0.0, -0.03))],
    ),
    one_of("kettle/burner", "layout", default=0.0, seen=(0.0, 1.0), held_out=(2.0,)),
)

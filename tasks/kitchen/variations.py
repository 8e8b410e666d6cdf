"""Groups of variations of the kitchen: how they vary the parameters of its scene."""

from kitchen_suite.tasks.varied import Varied, around, between, one_of


def _cabinet(name: str) -> Varied:
    """Offset of a cabinet, which hangs on the wall above the hood: forward, and up, or down where the hood is lowered.

    It cannot move back into the wall.
    """
    return between(
        name,
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((-0.025, -0.03, -0.015), (0.025, 0.0, 0.035)),
        held_out=[((-0.03, -0.04, 0.035), (-0.025, -0.03, 0.05)), ((0.025, -0.04, 0.035), (0.03, -0.03, 0.05))],
    )


# Poses of the furniture and of the robot's base [m, rad], and the burner of the kettle. The pedestal stands against the
# oven, so that it can only move back. A kettle on the top left burner would be at its goal.
LAYOUT: tuple[Varied, ...] = (
    between(
        "pedestal/offset",
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((-0.03, -0.025, 0.0), (0.03, 0.0, 0.0)),
        held_out=[((-0.04, -0.035, 0.0), (-0.03, -0.025, 0.0)), ((0.03, -0.035, 0.0), (0.04, -0.025, 0.0))],
    ),
    around("microwave/offset", "layout", default=(0.0, 0.0, 0.0), seen=(0.04, 0.04, 0.0), held_out=(0.05, 0.05, 0.0)),
    around("microwave/yaw", "layout", default=0.3, seen=0.1, held_out=0.14),
    _cabinet("slide_cabinet/offset"),
    _cabinet("hinge_cabinet/offset"),
    between(
        "hood/offset",
        "layout",
        default=(0.0, 0.0, 0.0),
        seen=((0.0, 0.0, -0.04), (0.0, 0.0, 0.0)),
        held_out=[((0.0, 0.0, -0.055), (0.0, 0.0, -0.04))],
    ),
    one_of("kettle/burner", "layout", default=0.0, seen=(0.0, 1.0), held_out=(2.0,)),
)

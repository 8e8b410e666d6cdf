"""The variations of the generated_kitchens domain."""

from kitchen_suite.tasks.episode.pushes import PUSH
from kitchen_suite.tasks.variations import appearance
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, one_of

VARIED: tuple[ParameterVariation, ...] = (
    around("franka/joint_offset", "start", seen=0.05, held_out=0.1),
    around("franka/gain_scale", "dynamics", seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", seen=0.1, held_out=0.2),
    around("fixtures/damping_scale", "dynamics", seen=0.3, held_out=0.5),
    around("fixtures/friction_scale", "dynamics", seen=0.3, held_out=0.5),
    one_of("sensing/action_delay", "sensing", seen=(0.0, 1.0), held_out=(1.0,)),
    *appearance.cameras("overview", "left", "right", "franka/wrist", "franka/hand"),
    *PUSH,
    # Last, so that a seed draws the other parameters as before there was this camera.
    *appearance.cameras("workspace"),
)

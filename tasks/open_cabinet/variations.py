"""Groups of variations of open_cabinet: how they vary the parameters of its scene."""

from kitchen_suite.tasks.varied import Varied, around

# Pose of the cabinet on the floor [m, rad]; those seen are the ones of the randomization `moderate`.
LAYOUT: tuple[Varied, ...] = (
    around("cabinet/offset", "layout", default=(0.0, 0.0, 0.0), seen=(0.03, 0.05, 0.0), held_out=(0.035, 0.06, 0.0)),
    around("cabinet/yaw", "layout", seen=0.1, held_out=0.115),
)

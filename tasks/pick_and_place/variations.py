"""The variations of the pick_and_place domain: those of generated kitchens, and of the objects."""

import numpy as np

from kitchen_suite.entities.object_layouts import MAX_OBJECTS
from kitchen_suite.tasks.generated_kitchens import variations as kitchens
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, between

# Displacement of each object at the start: x and y [m], and rotation about the vertical [rad].
_SEEN, _HELD_OUT = np.tile((0.015, 0.015, 0.3), MAX_OBJECTS), np.tile((0.025, 0.025, 0.5), MAX_OBJECTS)

VARIED: tuple[ParameterVariation, ...] = (
    *kitchens.VARIED,
    around("objects/displacement", "start", seen=_SEEN, held_out=_HELD_OUT),
    between("objects/mass_scale", "dynamics", seen=(0.7, 1.2), held_out=[(0.5, 0.7), (1.2, 1.4)]),
    between("objects/friction_scale", "dynamics", seen=(0.8, 1.3), held_out=[(0.6, 0.8), (1.3, 1.6)]),
)

"""The burner on which the kettle starts an episode, as a parameter of the kettle."""

import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.entities.parameters import Elements, Quantity, built_position

# Number of each burner as value of the parameter; on the first one the kettle stands by default.
BURNERS = ("bottom_left", "bottom_right", "top_right", "top_left")

# Displacement of the kettle from the first burner to each of them [m]: the differences between the positions of the
# burners in `xml/oven.xml`.
DISPLACEMENTS = np.array([(0.0, 0.0, 0.0), (0.446, 0.0, 0.0), (0.444, 0.441, 0.0), (0.003, 0.441, 0.0)])


def _read_burner(physics: mjcf.Physics, joints: Elements) -> ArrayLike:
    """Returns the number of the burner nearest to the object."""
    (joint,) = joints
    moved = physics.bind(joint).qpos[:3] - built_position(joint.parent)
    return np.argmin(np.linalg.norm(DISPLACEMENTS - moved, axis=1))


def _write_burner(physics: mjcf.Physics, joints: Elements, value: NDArray[np.float64]) -> None:
    """Moves an object that stands on the first burner to another one."""
    (joint,) = joints
    physics.bind(joint).qpos[:3] += DISPLACEMENTS[int(value)]


# The burner on which a free object stands; writing it moves the object from the first burner.
BURNER = Quantity(read=_read_burner, write=_write_burner, model_fields=(), choices=len(BURNERS))

"""Types of numbers, for annotations."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers of a shape that docstrings name."""

Vector = tuple[float, float, float]
"""Three numbers along x, y and z."""

Quaternion = tuple[float, float, float, float]
"""An orientation: w, x, y, z."""

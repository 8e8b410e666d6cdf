"""Imports mink, and restores NumPy's global random state: mink imports JAX where that is installed, and JAX draws."""

import numpy as np

_state = np.random.get_state()
import mink  # noqa: E402, F401

np.random.set_state(_state)

"""Scripted experts, which complete the suite's tasks from observations alone. They need the extra `experts`."""

import numpy as _np

import kitchen_suite.rendering.without_gl  # noqa: F401
from kitchen_suite import installation as _installation
from kitchen_suite.installation import EXTRA_PACKAGES as _EXTRA_PACKAGES

_installation.installed(_EXTRA_PACKAGES["experts"], "kitchen_suite.experts", "experts")

# mink imports JAX where that is installed, which draws from NumPy's global random state.
_state = _np.random.get_state()
import mink  # noqa: E402, F401

_np.random.set_state(_state)

from kitchen_suite.policies.experts.base import Expert, MotionStyle, expert_class, make, make_policy  # noqa: E402
from kitchen_suite.policies.experts.kitchen import KitchenExpert  # noqa: E402
from kitchen_suite.policies.experts.microwave_table import MicrowaveExpert  # noqa: E402
from kitchen_suite.policies.experts.open_cabinet import DrawerExpert  # noqa: E402

__all__ = [
    "DrawerExpert",
    "Expert",
    "KitchenExpert",
    "MicrowaveExpert",
    "MotionStyle",
    "expert_class",
    "make",
    "make_policy",
]

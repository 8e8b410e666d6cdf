"""Control modes by domain, and actions for them."""

import numpy as np
from dm_env import specs

SHARED = ("joint_delta", "ee_delta_position", "ee_delta_pose", "ee_pose", "joint_position")
MODES = {
    "kitchen": ("joint_velocity", *SHARED),
    "open_cabinet": ("joint_offset", *SHARED),
    "microwave_table": ("joint_offset", *SHARED),
}
CASES = [(domain, mode) for domain, modes in MODES.items() for mode in modes]


def walk(spec, steps, *leading, seed=0):
    """Actions `(steps, ..., k)` of a spec, correlated in time."""
    walks = np.cumsum(np.random.default_rng(seed).normal(scale=0.3, size=(steps, *leading, *spec.shape)), axis=0)
    if not isinstance(spec, specs.BoundedArray):
        return 0.02 * walks
    middle, half = (spec.maximum + spec.minimum) / 2.0, (spec.maximum - spec.minimum) / 2.0
    return middle + half * np.tanh(walks)

"""Sweeps of which every run plays some cases, and `pytest -m slow` the others; control modes by domain."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pytest
from dm_env import specs


def brief(cases: Iterable[Any], kept: Iterable[Any]) -> list[Any]:
    """Marks all cases of a sweep but those of `kept` as slow; a case of several arguments is a tuple."""
    cases, kept = [*cases], [*kept]
    assert kept
    assert all(case in cases for case in kept), kept
    return [pytest.param(*_arguments(case), marks=() if case in kept else pytest.mark.slow) for case in cases]


def brief_named(cases: Mapping[str, Any], kept: Iterable[str]) -> list[Any]:
    """Marks all cases of a sweep but those with a name of `kept` as slow; the names are the ids."""
    assert kept
    assert set(kept) <= set(cases), kept
    return [
        pytest.param(*_arguments(case), id=name, marks=() if name in kept else pytest.mark.slow)
        for name, case in cases.items()
    ]


def _arguments(case: Any) -> tuple[Any, ...]:
    return case if isinstance(case, tuple) else (case,)


SHARED = ("joint_delta", "ee_delta_position", "ee_delta_pose", "ee_pose", "joint_position")
MODES = {
    "kitchen": ("joint_velocity", *SHARED),
    "open_cabinet": ("joint_offset", *SHARED),
    "microwave_table": ("joint_offset", *SHARED),
    "kitchens": ("joint_velocity", *SHARED),
}
CASES = [(domain, mode) for domain, modes in MODES.items() for mode in modes]


def walk(spec, steps, *leading, seed=0):
    """Actions `(steps, ..., k)` of a spec, correlated in time."""
    walks = np.cumsum(np.random.default_rng(seed).normal(scale=0.3, size=(steps, *leading, *spec.shape)), axis=0)
    if not isinstance(spec, specs.BoundedArray):
        return 0.02 * walks
    middle, half = (spec.maximum + spec.minimum) / 2.0, (spec.maximum - spec.minimum) / 2.0
    return middle + half * np.tanh(walks)

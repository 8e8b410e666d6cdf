"""Sweeps of which every run plays some cases, `--run=full` and `--run=nightly` more; what the domains have."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from kitchen_suite import suite
from kitchen_suite.tasks.variations.distributions import GROUPS


def brief(cases: Iterable[Any], kept: Iterable[Any], full: Iterable[Any] = ()) -> list[Any]:
    """Marks cases of a sweep; one of several arguments is a tuple.

    Every run plays those of `kept`, a full one those of `full` as well, and a nightly one all.
    """
    cases = [*cases]
    marks = _marks(cases, [*kept], [*full])
    return [pytest.param(*_arguments(case), marks=mark) for case, mark in zip(cases, marks, strict=True)]


def brief_named(cases: Mapping[str, Any], kept: Iterable[str], full: Iterable[str] = ()) -> list[Any]:
    """Marks cases of a sweep as `brief` does, by their names, which are the ids."""
    marks = _marks([*cases], [*kept], [*full])
    return [
        pytest.param(*_arguments(case), id=name, marks=mark)
        for (name, case), mark in zip(cases.items(), marks, strict=True)
    ]


def _marks(cases: list[Any], kept: list[Any], full: list[Any]) -> list[Any]:
    assert kept
    assert all(case in cases for case in (*kept, *full)), (kept, full)
    return [() if case in kept else pytest.mark.full if case in full else pytest.mark.nightly for case in cases]


def _arguments(case: Any) -> tuple[Any, ...]:
    return case if isinstance(case, tuple) else (case,)


SHARED = ("joint_delta", "ee_delta_position", "ee_delta_pose", "ee_pose", "joint_position")
MODES = {
    "kitchen": ("joint_velocity", *SHARED),
    "open_cabinet": ("joint_offset", *SHARED),
    "microwave_table": ("joint_offset", *SHARED),
    "kitchens": ("joint_velocity", *SHARED),
    "pick_and_place": ("joint_velocity", *SHARED),
}
CASES = [(domain, mode) for domain, modes in MODES.items() for mode in modes]


# Groups of variations that a domain does not have: a design says where its fixtures are, and how they look.
_LACKING = dict.fromkeys(("kitchens", "pick_and_place"), ("layout", "appearance"))


def groups_of(domain: str) -> list[str]:
    """Returns the groups of variations that a domain has."""
    return [group for group in GROUPS if group not in _LACKING.get(domain, ())]


OBSERVED = [(name, obs_type) for name, domain in suite.DOMAINS.items() for obs_type in domain.env_class.obs_types]


def once_per_observation_type() -> list[tuple[str, str]]:
    """Returns a case of each observation type, in domains that take turns."""
    types = [*dict.fromkeys(obs_type for _, obs_type in OBSERVED)]
    cases = []
    for place, obs_type in enumerate(types):
        domains = [name for name, each in OBSERVED if each == obs_type]
        cases.append((domains[place % len(domains)], obs_type))
    assert {name for name, _ in cases} == {*suite.DOMAINS}
    return cases


def walk(spec, steps, *leading, seed=0):
    """Actions `(steps, ..., k)` of a spec, correlated in time."""
    walks = np.cumsum(np.random.default_rng(seed).normal(scale=0.3, size=(steps, *leading, *spec.shape)), axis=0)
    if not isinstance(spec, specs.BoundedArray):
        return 0.02 * walks
    middle, half = (spec.maximum + spec.minimum) / 2.0, (spec.maximum - spec.minimum) / 2.0
    return middle + half * np.tanh(walks)

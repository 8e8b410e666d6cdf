"""Sweeps of which every run plays some cases, and `pytest -m slow` the others."""

from collections.abc import Iterable, Mapping
from typing import Any

import pytest


def brief(cases: Iterable[Any], kept: Iterable[Any]) -> list[Any]:
    """Marks all cases of a sweep but those of `kept` as slow; a case of several arguments is a tuple."""
    cases, kept = [*cases], [*kept]
    assert kept
    assert all(case in cases for case in kept), kept
    return [case if case in kept else pytest.param(*_arguments(case), marks=pytest.mark.slow) for case in cases]


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

"""Comparisons of what environments return."""

from typing import Any

from gymnasium.utils.env_checker import data_equivalence


def assert_same(one: Any, other: Any) -> None:
    """Asserts that nested dicts, tuples and arrays are the same, with their types, shapes and all bits."""
    assert data_equivalence(one, other, exact=True), (one, other)

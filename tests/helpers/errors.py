"""Errors about bad input: of the right type, with the value, its place, and what is allowed."""

import contextlib
from collections.abc import Iterator

import pytest


@contextlib.contextmanager
def refused(error: type[Exception] | tuple[type[Exception], ...], *shown: str) -> Iterator[pytest.ExceptionInfo]:
    """Expects an error whose message has all of `shown`: the bad value, an argument's name, a choice."""
    with pytest.raises(error) as raised:
        yield raised
    message = str(raised.value)
    assert all(part in message for part in shown), message

"""Errors about bad input: of the right type, with the value, its place, and what is allowed."""

import contextlib
from collections.abc import Iterator

import numpy as np
import pytest


@contextlib.contextmanager
def refused(error: type[Exception] | tuple[type[Exception], ...], *shown: str) -> Iterator[pytest.ExceptionInfo]:
    """Expects an error whose message has all of `shown`: the bad value, an argument's name, a choice."""
    with pytest.raises(error) as raised:
        yield raised
    message = str(raised.value)
    assert all(part in message for part in shown), message


def assert_is_short(message: str) -> None:
    """Checks that a message of an error takes one line of limited length."""
    assert message.isprintable()
    assert len(message) < 1_000


class _Unshowable:
    def __repr__(self):
        raise ZeroDivisionError


def nested(depth, value=0):
    """A value in as many lists."""
    for _ in range(depth):
        value = [value]
    return value


# No argument of the suite takes any of them.
ODD_VALUES = {
    "nested": nested(100_000),
    "a long string": "x" * 1_000_000,
    "control characters": "a\nb\r\0\x1b[31m\u202e\ud800",
    "many bytes": b"x" * 1_000_000,
    "many keys": {f"{i}": i for i in range(100_000)},
    "a nested dict": {"kettle": {"mass": nested(2_000)}},
    "a large array": np.full((1_000, 1_000), np.nan),
    "an array of objects": np.array([{}, None, "x\ny"], object),
    "an int of 5,000 digits": 10**5_000,
    "an object without a repr": _Unshowable(),
}

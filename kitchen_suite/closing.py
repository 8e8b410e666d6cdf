"""Closes the resources of a constructor that fails."""

import contextlib
from collections.abc import Iterable, Iterator
from typing import Protocol


class Closeable(Protocol):
    """An object with resources that `close` frees: threads, a GL context, a port or a connection."""

    def close(self) -> object:
        """Frees the resources."""


@contextlib.contextmanager
def closed_on_error(opened: Iterable[Closeable]) -> Iterator[None]:
    """Context that closes what has been opened if it ends by an error, or an interrupt; otherwise all stays open.

    Args:
      opened: read at the error, so that it may grow within the context.
    """
    try:
        yield
    except BaseException:
        with contextlib.ExitStack() as stack:
            for each in opened:
                stack.callback(each.close)
        raise

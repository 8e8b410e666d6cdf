"""The signals and standard streams of a command that runs as a process of its own."""

import contextlib
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from io import TextIOWrapper
from types import FrameType
from typing import Any, cast

# Signals that interrupt: Ctrl-C, and what batch systems stop a job with.
_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_RAISE_AGAIN_AFTER = 0.01  # [s]

_interrupts: list[int] = []


def raise_interrupts() -> None:
    """Lets SIGINT and SIGTERM raise KeyboardInterrupt, also where one arrives while Python calls a destructor.

    SIGINT stays ignored where it is, as in a shell's background jobs.
    """
    for number in _SIGNALS:
        if number is not signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    signal.signal(signal.SIGALRM, _interrupt)
    sys.unraisablehook = _raise_again


@contextlib.contextmanager
def interrupts_prevail() -> Iterator[None]:
    """Raises KeyboardInterrupt after an interrupt, whatever the code within has made of it.

    Imports of extension modules, for example, raise an ImportError instead.
    """
    try:
        yield
    except Exception as error:
        if _interrupts:
            raise KeyboardInterrupt from error
        raise
    if _interrupts:
        raise KeyboardInterrupt


def open_closed_streams() -> None:
    """Opens the null device for each closed standard stream, and lets stdout escape characters that it cannot encode.

    Files that are opened later would get the numbers of closed streams, and libraries would write to them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Also for child processes, such as the one in which glfw looks for its library.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")
    cast(TextIOWrapper, sys.stdout).reconfigure(errors="backslashreplace")


def shorten_warnings() -> None:
    """Lets each Python warning take one line, without the line of code that it is about."""
    warnings.formatwarning = _format_warning


def _format_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    return f"{category.__name__}: {message}\n"


def discard_stdout() -> None:
    """Sends stdout, with what Python still has to flush at exit, to the null device."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _interrupt(number: int, frame: FrameType | None) -> None:
    _interrupts.append(number)
    raise KeyboardInterrupt


def _raise_again(unraisable: Any) -> None:
    """Raises an interrupt again that Python has dropped, since a destructor cannot raise exceptions."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        signal.setitimer(signal.ITIMER_REAL, _RAISE_AGAIN_AFTER)
    else:
        sys.__unraisablehook__(unraisable)

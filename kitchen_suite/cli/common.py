"""What command lines of the suite share: how they parse, what they print when something is wrong, how they end."""

import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from absl import flags

FAILURE, USAGE, INTERRUPTED, BROKEN_PIPE = 1, 2, 130, 141


def parse(values: flags.FlagValues, name: str, arguments: Sequence[str], *, most: int = 0) -> list[str]:
    """Takes up a command line anew, whatever was parsed before.

    Args:
      values: the command's own flags.
      name: of the command.
      arguments: without the program's name.
      most: how many of them need not be flags.

    Returns:
      Those that are no flags.

    Raises:
      flags.Error: a flag is unknown or its value bad, or there are too many other arguments.
    """
    values.unparse_flags()
    _, *rest = values([name, *arguments])
    if len(rest) > most:
        raise flags.Error(f"unexpected argument {rest[most]!r}: all others are flags, see --help")
    return rest


def describe(values: flags.FlagValues, introduction: str | None) -> str:
    """What --help shows."""
    # absl heads the list with two lines that name the module.
    return "\n".join([introduction or "", *values.get_help(include_special_flags=False).splitlines()[2:]])


def fail(name: str, problem: object, status: int) -> int:
    """Says in one line what is wrong; returns the exit status."""
    print(f"{name}:", " ".join(str(problem).split()), file=sys.stderr)
    return status


def perform(
    name: str,
    work: Callable[[], int | None],
    *,
    interrupted: Callable[[], str],
    failures: tuple[type[Exception], ...],
    misuses: tuple[type[Exception], ...] = (),
) -> int:
    """Does what a command was asked for; returns the exit status.

    Args:
      name: of the command.
      work: what it does; may give an exit status.
      interrupted: tells after an interrupt how far it came.
      failures: exceptions that end it in one line and with `FAILURE`; but a broken pipe is not this command's to tell.
      misuses: exceptions that end it in one line and with `USAGE`.
    """
    try:
        return work() or 0
    except KeyboardInterrupt:
        return fail(name, interrupted(), INTERRUPTED)
    except BrokenPipeError:
        raise
    except misuses as error:
        return fail(name, error, USAGE)
    except failures as error:
        return fail(name, error, FAILURE)


def run_as_process(main: Callable[[], int]) -> int:
    """Runs a command as a process of its own; returns the exit status."""
    # Batch systems stop a job with SIGTERM: it should tidy up as after Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        status = main()
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has left. What Python still wants to flush at exit goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    return status


def check_json_object(text: str) -> bool:
    """Validates a flag that takes a JSON object.

    Raises:
      flags.ValidationError: it is none.
    """
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise flags.ValidationError(f"not JSON: {error}") from error
    if not isinstance(value, dict):
        raise flags.ValidationError("must be a JSON object")
    return True


def check_video(path: str | None) -> bool:
    """Validates the name of a video.

    Raises:
      flags.ValidationError: it is none that can be written.
    """
    if path is None:
        return True
    if not path.endswith(".mp4") or Path(path).is_dir():
        raise flags.ValidationError("must be a file that ends with .mp4")
    if not os.access(folder := Path(path).parent, os.W_OK) or not folder.is_dir():
        raise flags.ValidationError(f"there is no folder {str(folder)!r} that may be written to")
    return True

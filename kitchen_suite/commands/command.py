"""A command: its flags, its help, and how it ends, in this process or as one of its own."""

import contextlib
import dataclasses
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

from absl import flags

from kitchen_suite import checks
from kitchen_suite._version import __version__

# Exit statuses of the commands.
SUCCESS = 0
FAILURE = 1
USAGE = 2
GATE = 4  # The work was done, and its result is one to fail on, such as by --fail_under; 3 is of `kitchen-replay`.
INTERRUPTED = 130
BROKEN_PIPE = 141

# Problems with what a command is given; all other OSErrors are failures of its work.
_BAD_ARGUMENTS = (
    flags.Error,
    FileExistsError,
    FileNotFoundError,
    ImportError,
    IsADirectoryError,
    NotADirectoryError,
    TypeError,
    ValueError,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Command:
    """A console script.

    Attributes:
      name: of the script.
      description: text above the flags in `--help`; its first sentence is the command's in the list of all.
      define: defines the command's flags.
      run: does the work with the values of the flags, and with the arguments without a flag where there are any;
        returns an exit status, None for success.
      positional: name of the arguments without a flag, which are required; None for a command without.
      positional_counts: how many of them there may be.
    """

    name: str
    description: str
    define: Callable[[flags.FlagValues], None]
    run: Callable[..., int | None]
    positional: str | None = None
    positional_counts: range = range(1, 2)

    def __call__(self) -> int:
        return run_process(self.name, self.main)

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Runs the command with some arguments, by default those of this process; returns the exit status."""
        given = sys.argv[1:] if arguments is None else [*arguments]
        try:
            if "--help" in given or "-h" in given:
                print(self.help_text())
                return SUCCESS
            if "--version" in given:
                print(f"{self.name} {__version__}")
                return SUCCESS
            values, *others = self.parse(given)
            return self.run(values, *others) or SUCCESS
        except BrokenPipeError:
            raise
        except checks.WorkFailedError as error:
            return fail(self.name, error, FAILURE)
        except _BAD_ARGUMENTS as error:
            return fail(self.name, error, USAGE)
        except OSError as error:
            return fail(self.name, error, FAILURE)
        except KeyboardInterrupt:
            return fail(self.name, "interrupted", INTERRUPTED)
        except RuntimeError as error:
            from dm_control.rl.control import PhysicsError

            if not isinstance(error, PhysicsError):
                raise
            return fail(self.name, error, FAILURE)

    def flags(self) -> flags.FlagValues:
        """Returns the flags of the command, with their defaults."""
        # Not absl's global flags, so that a command can be called from other programs, any number of times.
        values = flags.FlagValues()
        # Flags may stand behind the argument without a flag.
        values.set_gnu_getopt(True)
        self.define(values)
        flags.DEFINE_boolean("help", False, "Show this help, and exit.", values, short_name="h")
        flags.DEFINE_boolean("version", False, "Show the version of the suite, and exit.", values)
        return values

    def parse(self, arguments: Sequence[str]) -> list[Any]:
        """Returns the flags with the values of arguments, and the arguments without a flag where there are any.

        Raises an `absl.flags.Error` for bad arguments.
        """
        values = self.flags()
        try:
            _, *others = values([self.name, *arguments])
        except flags.UnrecognizedFlagError as error:
            near = checks.nearest(error.flagname, [*values])
            hint = f" (did you mean --{near}?)" if near else ""
            raise flags.Error(f"there is no flag --{error.flagname}{hint}; --help lists all") from error
        counts = range(1) if self.positional is None else self.positional_counts
        if not others and 0 not in counts:
            raise flags.Error(f"{self.positional} is missing, the argument without a flag: see --help")
        if len(others) < counts[0]:
            raise flags.Error(f"{self.positional}: at least {counts[0]} are needed, got {checks.shown(others)}")
        if unexpected := others[counts[-1] :]:
            raise flags.Error(f"unexpected argument {checks.shown(unexpected[0])}: all others are flags, see --help")
        return [values, *others]

    def help_text(self) -> str:
        """Returns the text of `--help`: the description, and absl's description of each flag."""
        described = self.flags().get_help(include_special_flags=False)
        # A heading for each module that defines flags says nothing to who calls a command.
        listed = re.sub(r"^\S.*:\n", "", described, flags=re.MULTILINE).strip("\n")
        return f"{self.description.strip()}\n\nFlags:\n{listed}"


def fail(name: str, problem: object, status: int) -> int:
    """Reports a problem in one line on stderr, if that can be written to; returns the exit status."""
    with contextlib.suppress(OSError):
        # It may quote any argument.
        print(f"{name}:", checks.shortened(str(problem), 1000), file=sys.stderr)
    return status


def run_process(name: str, main: Callable[[], int]) -> int:
    """Runs `main` as the process of a command, which SIGTERM interrupts as Ctrl-C does; both return the exit status."""
    # Python's warnings take one line, without the line of code that they are about.
    warnings.formatwarning = lambda message, category, *_, **__: (
        f"{category.__name__}: {checks.printable(str(message))}\n"
    )
    # Python has none where the process was started with closed streams.
    sys.stdout = sys.stdout or io.StringIO()
    sys.stderr = sys.stderr or io.StringIO()
    # Batch systems stop a job with it.
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        status = main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        return fail(name, "interrupted", INTERRUPTED)
    except OSError as error:
        # What Python still has to flush at exit is sent to the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # The reader of the output has left.
            return BROKEN_PIPE
        return fail(name, f"stdout cannot be written to: {error}", FAILURE)
    return status


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt

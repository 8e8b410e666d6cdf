"""The commands, a module each; this is the table of them, and `kitchen-suite`, which runs any.

Each is a console script, such as `kitchen-record`; from Python, `record.main(["--output=runs"])` runs it. The modules
that do the work are imported when a command runs, so that its help is printed at once.
"""

import importlib
import sys
from collections.abc import Sequence

from kitchen_suite import checks
from kitchen_suite._version import __version__
from kitchen_suite.commands.command import SUCCESS, USAGE, Command, fail, run_process

NAMES = (
    "rollout",
    "record",
    "replay",
    "play",
    "train",
    "evaluate",
    "compare",
    "convert",
    "view",
    "export",
    "doctor",
)


def find(name: str) -> Command:
    """Returns the command of a name, such as `record`; raises a ValueError for another name."""
    checks.choice(name, NAMES, "command")
    return importlib.import_module(f"{__name__}.{name}").COMMAND


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command that the first argument names with the others, or lists all; returns the exit status."""
    name, *others = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if name in ("--help", "-h"):
        print("kitchen-suite COMMAND [--help] runs one of the commands:\n")
        for each in NAMES:
            sentence = find(each).description.partition("\n")[0].partition(". ")[0]
            print(f"  {each:<10} {sentence.rstrip('.')}.")
        return SUCCESS
    if name == "--version":
        print(f"kitchen-suite {__version__}")
        return SUCCESS
    try:
        command = find(name)
    except ValueError as error:
        return fail("kitchen-suite", error, USAGE)
    return command.main(others)


def console() -> int:
    """Runs `kitchen-suite` as a process of its own; returns the exit status."""
    return run_process("kitchen-suite", main)

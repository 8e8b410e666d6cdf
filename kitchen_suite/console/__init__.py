"""The console scripts, beside the package, since its import takes some tenths of a second.

Until the command handles interrupts itself, SIGINT and SIGTERM end its process at once, with one line and status 130.
Before Python has imported this module, SIGTERM ends the process without a line, and SIGINT with a traceback.
"""

import contextlib
import functools
import os
import signal


def run(name: str) -> int:
    """Runs a console script as a process of its own; returns the exit status."""

    def end(*_: object) -> None:
        with contextlib.suppress(OSError):
            os.write(2, f"{name}: interrupted\n".encode())
        os._exit(130)

    for number in (signal.SIGINT, signal.SIGTERM):
        # Shells start background jobs with SIGINT ignored.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, end)
    from kitchen_suite.cli import commands

    return commands.console_main() if name == "kitchen-suite" else commands.COMMANDS[name.removeprefix("kitchen-")]()


suite = functools.partial(run, "kitchen-suite")
rollout = functools.partial(run, "kitchen-rollout")
record = functools.partial(run, "kitchen-record")
replay = functools.partial(run, "kitchen-replay")
benchmark = functools.partial(run, "kitchen-benchmark")
train = functools.partial(run, "kitchen-train")
play = functools.partial(run, "kitchen-play")
convert = functools.partial(run, "kitchen-convert")
evaluate = functools.partial(run, "kitchen-evaluate")
verify = functools.partial(run, "kitchen-verify")
certify = functools.partial(run, "kitchen-certify")
doctor = functools.partial(run, "kitchen-doctor")
export = functools.partial(run, "kitchen-export")
view = functools.partial(run, "kitchen-view")

"""Processes that are interrupted as from a terminal, and what other processes and threads do in their own time."""

import signal
import subprocess
import time

import pytest


def heed_interrupts():
    """Undoes that a shell's background jobs ignore SIGINT, which they hand down to what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def open_process(command, **options):
    """Starts a command that SIGINT interrupts, and whose stdout and stderr are read as text."""
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
        **options,
    )


def wait_until(condition):
    """Waits until a condition holds, for ten minutes at most, since machines have other work."""
    end = time.monotonic() + 600
    while not condition():
        if time.monotonic() > end:
            pytest.fail("the condition does not hold")
        time.sleep(0.05)

"""Processes that are interrupted as from a terminal."""

import signal
import subprocess


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

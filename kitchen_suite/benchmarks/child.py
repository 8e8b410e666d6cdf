"""Preparation of a process that measures memory; it must not import dm_control before `gl.prepare`."""

import signal

from kitchen_suite.rendering import gl


def prepare() -> None:
    """Imports dm_control without a GL library, and lets Ctrl-C, which the command reports, end the process silently."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    gl.prepare(rendering=False)

"""Programs on a machine without a display, whose user has set no variable of rendering."""

import os
import subprocess
import sys

UNSET = {
    name: value
    for name, value in os.environ.items()
    if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY", "WAYLAND_DISPLAY")
}


def run(code, *, timeout=300, folder=None, **variables):
    """Runs a program; returns its status, negative for a signal, and its stdout and stderr."""
    environment = {**UNSET, **variables}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, timeout=timeout)
    return done.returncode, done.stdout, done.stderr

"""Chooses the GL library that MuJoCo renders with, if any, which must happen before dm_control is first imported."""

import os
import subprocess
import sys

_VARIABLE = "MUJOCO_GL"
_HEADLESS = ("egl", "osmesa")
_RENDER_ONE_FRAME = "from dm_control import mujoco; mujoco.Physics.from_xml_string('<mujoco/>').render(8, 8)"


def prepare(*, rendering: bool) -> None:
    """Sets `MUJOCO_GL` if it is not set, and sees to it that dm_control can be imported with it.

    Args:
      rendering: whether images will be asked for; without them no GL library is needed or loaded.

    Raises:
      OSError: images are asked for, but with this `MUJOCO_GL`, or where it is not set with any library that needs no
        display, nothing can be rendered; or dm_control cannot be imported.
    """
    given = os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = _working_library() if rendering else "disable"
    try:
        import dm_control.mujoco  # noqa: F401
    except Exception as error:  # PyOpenGL raises whatever its first call on a missing library comes to.
        raise OSError(f"dm_control does not work with {_VARIABLE}={os.environ[_VARIABLE]}: {error}") from error
    if not rendering:
        # It was set for this import alone; what the process starts next may want to render.
        os.environ.pop(_VARIABLE)
        os.environ.update({_VARIABLE: given} if given is not None else {})


def _working_library() -> str:
    candidates = (os.environ[_VARIABLE],) if _VARIABLE in os.environ else _HEADLESS
    for library in candidates:
        if _renders(library):
            return library
    raise OSError(
        f"nothing can be rendered here with {_VARIABLE}={' or '.join(candidates)}: install a GL library (Debian: "
        f"libegl1 libgl1-mesa-dri, or libosmesa6), and leave {_VARIABLE} unset to let it be found"
    )


def _renders(library: str) -> bool:
    """Whether a frame can be rendered; tried in another process, as a failed attempt cannot be undone."""
    command = [sys.executable, "-c", _RENDER_ONE_FRAME]
    return subprocess.run(command, env={**os.environ, _VARIABLE: library}, capture_output=True).returncode == 0

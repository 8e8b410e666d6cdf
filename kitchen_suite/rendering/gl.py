"""Chooses MuJoCo's GL library; to be called before dm_control is first imported, which loads the library."""

import os
import subprocess
import sys

_VARIABLE = "MUJOCO_GL"
_HEADLESS_LIBRARIES = ("egl", "osmesa")
_RENDER_ONE_FRAME = "from dm_control import mujoco; mujoco.Physics.from_xml_string('<mujoco/>').render(8, 8)"


def prepare(*, rendering: bool) -> None:
    """Imports dm_control with a GL library that works; sets `MUJOCO_GL` if it is unset and images will be rendered.

    Args:
      rendering: whether images will be rendered; otherwise no GL library is loaded.

    Raises:
      OSError: images will be rendered, but neither the library that `MUJOCO_GL` names nor, where it is unset, any
        headless one works; or dm_control cannot be imported.
    """
    given = os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = _find_library() if rendering else "disable"
    try:
        import dm_control.mujoco  # noqa: F401
    except Exception as error:  # PyOpenGL raises exceptions of many types if the library is missing.
        raise OSError(f"dm_control does not work with {_VARIABLE}={os.environ[_VARIABLE]}: {error}") from error
    if not rendering:
        # "disable" was meant for this import alone: child processes may render.
        os.environ.pop(_VARIABLE)
        os.environ.update({_VARIABLE: given} if given is not None else {})


def _find_library() -> str:
    """Returns the library that `MUJOCO_GL` names or, where it is unset, the first headless one, if it can render."""
    candidates = (os.environ[_VARIABLE],) if _VARIABLE in os.environ else _HEADLESS_LIBRARIES
    for library in candidates:
        if _can_render(library):
            return library
    raise OSError(
        f"nothing can be rendered here with {_VARIABLE}={' or '.join(candidates)}: install a GL library (Debian: "
        f"libegl1 libgl1-mesa-dri, or libosmesa6), and leave {_VARIABLE} unset to let it be found"
    )


def _can_render(library: str) -> bool:
    """Returns whether a frame can be rendered; tried in a child process, since a failed attempt cannot be undone."""
    command = [sys.executable, "-c", _RENDER_ONE_FRAME]
    return subprocess.run(command, env={**os.environ, _VARIABLE: library}, capture_output=True).returncode == 0

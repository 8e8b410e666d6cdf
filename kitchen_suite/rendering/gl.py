"""Chooses MuJoCo's GL library. dm_control loads the library that `MUJOCO_GL` names when it is first imported."""

import atexit
import contextlib
import ctypes
import functools
import importlib
import os
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

from kitchen_suite import checks

_VARIABLE = "MUJOCO_GL"
_HEADLESS_LIBRARIES = ("egl", "osmesa")
_VALUES = (*_HEADLESS_LIBRARIES, "glfw", "disable")

# Further values of dm_control: other names of GLFW, and all that switch rendering off.
_GLFW = ("on", "enable", "enabled", "true", "1")
_DISABLED = ("off", "disable", "disabled", "false", "0")

_DM_CONTROL_RENDERER = "dm_control._render"
_RENDER_ONE_FRAME = "from dm_control import mujoco; mujoco.Physics.from_xml_string('<mujoco/>').render(8, 8)"

# EGL_PLATFORM_DEVICE_EXT of EGL's headers: displays of graphics cards and of software, without a window system.
_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 32


class ContextOwner(Protocol):
    """An object that holds a GL context."""

    def free_context(self) -> None:
        """Frees the GL context."""

    def leave_context(self) -> None:
        """Forgets the GL context, without a GL call, in a process that was forked."""


def prepare(*, rendering: bool | None) -> None:
    """Imports dm_control for a command. If images will be rendered, a GL library is tried and chosen before.

    Then it sets `MUJOCO_GL` if that is unset; otherwise no GL library is loaded. With None, for images that may be
    rendered, one is loaded where that is possible, as `import_dm_control` does.

    Raises:
      OSError: images will be rendered, but neither the library that `MUJOCO_GL` names nor, where it is unset, any
        headless one works; or dm_control cannot be imported.
    """
    if rendering is None:
        import_dm_control()
    if rendering:
        os.environ[_VARIABLE] = find_library()
    try:
        with _variable(os.environ[_VARIABLE] if rendering else "disable"):
            import dm_control.mujoco  # noqa: F401
    except Exception as error:  # PyOpenGL raises exceptions of many types if the library is missing.
        raise OSError(f"dm_control does not work with {_VARIABLE}={os.environ.get(_VARIABLE)}: {error}") from error


def import_dm_control() -> None:
    """Imports dm_control's renderer so that a library or notebook can render without setting `MUJOCO_GL`.

    The suite's packages call it before they import dm_control. It sets `MUJOCO_GL` to a headless library where the
    variable is unset and there is no display. Where no GL library can be loaded, dm_control is imported without one,
    and `making_context` raises the error when an image is rendered.
    """
    if _DM_CONTROL_RENDERER in sys.modules:
        return
    given = _choose()
    try:
        with _variable("disable" if given is None and not has_display() else given):
            importlib.import_module(_DM_CONTROL_RENDERER)
    except Exception:  # PyOpenGL raises exceptions of many types if the library is missing.
        with _variable("disable"):
            importlib.import_module(_DM_CONTROL_RENDERER)


@contextlib.contextmanager
def making_context(owner: ContextOwner) -> Iterator[None]:
    """Context in which a GL context is made, with a library chosen as `import_dm_control` does.

    The owner frees it at exit; garbage collection would free it after its display, and print errors to stderr. If it
    cannot be made, the message of a RuntimeError says why, and what to do.
    """
    _check_process()
    library = _choose()
    if library is None and not has_display():
        raise RuntimeError(_advice(" or ".join(_HEADLESS_LIBRARIES)))
    if problem := _problem(library):
        raise RuntimeError(problem)
    if not _IS_INSTALLED.get(library or "", lambda: True)():
        raise RuntimeError(_advice(library))
    _processes.add(os.getpid())
    # The context before it has been freed.
    _threads.pop(owner, None)
    try:
        yield
    except (TypeError, ValueError):  # A bad argument.
        raise
    except Exception as error:
        raise RuntimeError(_after_fork("loaded it") if os.getpid() != _PROCESS else _advice(library)) from error
    _owners.add(owner)
    # Functions registered last are called first, and making a context may have registered the end of the display.
    atexit.unregister(_free_contexts)
    atexit.register(_free_contexts)


def making_dm_control_context(owner: ContextOwner) -> contextlib.AbstractContextManager[None]:
    """As `making_context`, for a GL context of dm_control, which may have chosen its library without the suite."""
    chosen = sys.modules[_DM_CONTROL_RENDERER].BACKEND
    if chosen == "glfw" and not has_display() and os.environ.get(_VARIABLE) != "glfw":
        raise RuntimeError(
            "nothing can be rendered here: dm_control was imported before kitchen_suite and chose GLFW, which needs a "
            f"display; import kitchen_suite.suite first, or set {_VARIABLE}=egl"
        )
    return making_context(owner)


@contextlib.contextmanager
def rendering(owner: ContextOwner) -> Iterator[None]:
    """Context in which an owner renders; raises a RuntimeError after a fork, or if another thread has its context."""
    _check_process()
    thread = threading.current_thread()
    try:
        yield
    except (TypeError, ValueError):  # A bad argument.
        raise
    except Exception as error:
        holder = _threads.get(owner, thread)
        if holder is thread:
            raise
        raise RuntimeError(
            f"nothing can be rendered in thread {thread.name!r}: the environment has rendered in thread "
            f"{holder.name!r}, which holds its GL context; render in that thread, or close() it there first"
        ) from error
    _threads[owner] = thread


def _check_process() -> None:
    """Raises a RuntimeError if a process from which this one was forked has rendered: a GL call would never return."""
    if _processes - {os.getpid()}:
        raise RuntimeError(_after_fork("rendered"))


def _after_fork(done: str) -> str:
    return (
        "nothing can be rendered here: threads of the GL library do not survive a fork, and the process that this one "
        f"was forked from has {done}; start processes with the method 'spawn' or 'forkserver'"
    )


_owners: weakref.WeakSet[ContextOwner] = weakref.WeakSet()

# By owner, the thread that rendered last.
_threads: weakref.WeakKeyDictionary[ContextOwner, threading.Thread] = weakref.WeakKeyDictionary()

# Numbers of the processes that have made GL contexts: of this one, and of those that it was forked from.
_processes: set[int] = set()

# Number of the process that imported the suite, and with it a GL library: some drivers render in none that is forked
# after that.
_PROCESS = os.getpid()


def _free_contexts() -> None:
    for owner in tuple(_owners):
        owner.free_context()


def _leave_contexts() -> None:
    """Lets a forked process close environments and exit without GL calls on what it inherited: some never return."""
    for owner in tuple(_owners):
        owner.leave_context()
    atexit.unregister(_free_contexts)
    if egl := sys.modules.get("OpenGL.EGL"):
        atexit.unregister(egl.eglTerminate)


def keep_forever(inherited: object) -> None:
    """Prevents that an object is destroyed, also when the interpreter ends, where module globals are."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(inherited))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_contexts)


def check_window() -> None:
    """Raises a RuntimeError unless a window can be shown. Without a display, Gymnasium's window ends the process."""
    if has_display():
        import warnings

        import glfw

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if glfw.init() and glfw.get_primary_monitor():
                return
    raise RuntimeError(
        "render_mode 'human' shows a window, but there is no display here; use 'rgb_array', or a virtual display "
        "(Debian: xvfb-run)"
    )


def has_display() -> bool:
    """Returns whether there may be a display: on Linux, whether X11 or Wayland names one."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _choose() -> str | None:
    """Returns the library that `MUJOCO_GL` names. Where it is unset, names a headless one if there is no display."""
    if not os.environ.get(_VARIABLE) and not has_display() and (library := installed_library()):
        os.environ[_VARIABLE] = library
    return os.environ.get(_VARIABLE) or None


def _problem(library: str | None) -> str:
    """Returns why a value of `MUJOCO_GL` names no library to render with; empty if it names one or is unset."""
    if library in _DISABLED:
        return f"rendering is disabled by {_VARIABLE}={library}: unset it to let a GL library be found"
    try:
        if library and library not in _GLFW:
            checks.choice(library, _VALUES, _VARIABLE)
    except ValueError as error:
        return str(error)
    return ""


def _advice(library: str | None) -> str:
    if library is None:
        return f"nothing can be rendered here on the display; set {_VARIABLE}=egl, which needs none"
    return (
        f"nothing can be rendered here with {_VARIABLE}={library}: install a GL library (Debian: "
        f"libegl1 libgl1-mesa-dri, or libosmesa6), and leave {_VARIABLE} unset to let it be found"
    )


@contextlib.contextmanager
def _variable(value: str | None) -> Iterator[None]:
    """Context in which `MUJOCO_GL` has a value; None leaves it as it is."""
    given = os.environ.get(_VARIABLE)
    if value is not None:
        os.environ[_VARIABLE] = value
    try:
        yield
    finally:
        os.environ.pop(_VARIABLE, None)
        os.environ.update({_VARIABLE: given} if given is not None else {})


def find_library() -> str:
    """Returns the library that `MUJOCO_GL` names or, where it is unset, the first headless one, if it can render."""
    given = os.environ.get(_VARIABLE)
    if problem := _problem(given):
        raise OSError(problem)
    candidates = (given,) if given else _HEADLESS_LIBRARIES
    for library in candidates:
        if can_render(library):
            return library
    raise OSError(_advice(" or ".join(candidates)))


@functools.cache
def can_render(library: str) -> bool:
    """Returns whether a frame can be rendered; tried in a child process, since a failed attempt cannot be undone."""
    command = [sys.executable, "-c", _RENDER_ONE_FRAME]
    return subprocess.run(command, env={**os.environ, _VARIABLE: library}, capture_output=True).returncode == 0


def installed_library() -> str | None:
    """Returns the first headless library that can be loaded; renders nothing, so that it takes milliseconds."""
    return next((library for library in _HEADLESS_LIBRARIES if _IS_INSTALLED[library]()), None)


@functools.cache
def _has_egl_display() -> bool:
    """Returns whether EGL has a headless display, which dm_control needs when it is imported."""
    egl = _load("libEGL.so.1")
    if egl is None:
        return False
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglInitialize.argtypes = (ctypes.c_void_p,) * 3
    query, get = map(egl.eglGetProcAddress, (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT"))
    if not query or not get:
        return False
    devices, count = (ctypes.c_void_p * _MAX_DEVICES)(), ctypes.c_int()
    pointer, number = ctypes.c_void_p, ctypes.c_uint
    ctypes.CFUNCTYPE(number, ctypes.c_int, pointer, pointer)(query)(_MAX_DEVICES, devices, ctypes.addressof(count))
    display_of = ctypes.CFUNCTYPE(pointer, number, pointer, pointer)(get)
    displays = (display_of(_PLATFORM_DEVICE, device, None) for device in devices[: count.value])
    return any(display and egl.eglInitialize(display, None, None) for display in displays)


@functools.cache
def _has_osmesa() -> bool:
    return any(_load(f"libOSMesa.so{version}") for version in (".8", ".6", ""))


# By value of `MUJOCO_GL`.
_IS_INSTALLED: Mapping[str, Callable[[], bool]] = {"egl": _has_egl_display, "osmesa": _has_osmesa, "glfw": has_display}


def _load(name: str) -> ctypes.CDLL | None:
    try:
        return ctypes.CDLL(name)
    except OSError:
        return None

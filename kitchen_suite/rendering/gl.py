"""The GL library that images are rendered with: it is chosen, and opened, for the first image of a process.

A library that only images need is not opened before: `without_gl` has the reason. `contexts` has what is made with it.
"""

import atexit
import contextlib
import ctypes
import functools
import importlib.util
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from kitchen_suite import checks

_VARIABLE = "MUJOCO_GL"
_PYOPENGL = "PYOPENGL_PLATFORM"
_HEADLESS_LIBRARIES = ("egl", "osmesa")
_VALUES = (*_HEADLESS_LIBRARIES, "glfw", "disable")

# Further values of dm_control: other names of GLFW, and all that switch rendering off.
_GLFW = ("on", "enable", "enabled", "true", "1")
_DISABLED = ("off", "disable", "disabled", "false", "0")

_RENDER_ONE_FRAME = "from dm_control import mujoco; mujoco.Physics.from_xml_string('<mujoco/>').render(8, 8)"

# EGL_PLATFORM_DEVICE_EXT of EGL's headers: displays of graphics cards and of software, without a window system.
_PLATFORM_DEVICE = 0x313F
_MAX_DEVICES = 32

# The libraries that this process has mapped, on Linux.
_MAPS = Path("/proc/self/maps")

# Of Mesa's software driver.
_LLVM = "libLLVM"

# Parts of the names of drivers, which are open only where a GL library has been initialised.
_DRIVERS = ("_dri.so", "libgallium", "libGLX_", "libOSMesa", "libEGL_nvidia", "libnvidia-eglcore", _LLVM)

# The library that `prepare` found.
_library: str | None = None

# Numbers of the processes that have made GL contexts: of this one, and of those that it was forked from.
_processes: set[int] = set()

# Number of the process in which other code had opened a GL library before the suite was imported.
_process_of_others: int | None = None


def prepare(*, rendering: bool | None) -> None:
    """Finds the GL library for a command that will render images, by rendering one in another process.

    With None, for images that may be rendered, and with False nothing is done.

    Raises:
      OSError: images will be rendered, but neither the library that `MUJOCO_GL` names nor, where it is unset, any
        headless one works.
    """
    global _library
    if rendering:
        _library = find_library()


@contextlib.contextmanager
def opening() -> Iterator[str]:
    """Context in which a GL library is opened or a GL context is made; yields `egl`, `osmesa` or `glfw`.

    Raises:
      RuntimeError: no image can be rendered; the message says why, and what to do.
    """
    check_process()
    library = choose()
    load_triton()
    if not _IS_INSTALLED[library]():
        raise RuntimeError(_reason(library))
    _processes.add(os.getpid())
    try:
        yield library
    except (TypeError, ValueError):  # A bad argument.
        raise
    except Exception as error:  # PyOpenGL raises exceptions of many types.
        raise RuntimeError(_reason(library)) from error


def choose() -> str:
    """Returns the library to render with: `egl`, `osmesa` or `glfw`.

    It is the one that `MUJOCO_GL` names. Where that is unset, it is the one that `prepare` found or, without a command,
    GLFW on a display and otherwise the first headless one that is installed.

    Raises:
      RuntimeError: `MUJOCO_GL` has another value, or no library is installed.
    """
    given = os.environ.get(_VARIABLE)
    if problem := _problem(given):
        raise RuntimeError(problem)
    if given:
        return "glfw" if given in _GLFW else given
    if _library is not None:
        return _library
    load_triton()
    library = installed_library()
    if library is None:
        raise RuntimeError(_reason(" or ".join(_HEADLESS_LIBRARIES)))
    return library


def load_triton() -> None:
    """Loads the library of triton, where that is installed, before a GL library is opened.

    PyTorch brings triton, which contains LLVM. Mesa's driver opens its own LLVM for all of the process, and triton, if
    it is loaded later, calls functions of that one: the process ends by signal 11. Loaded before, both keep their own.
    Where Mesa's is there already, triton is made to prefer its own; not otherwise, since it then also passes over the
    memory allocators that some people preload.
    """
    if not sys.platform.startswith("linux"):
        return
    mode = os.RTLD_NOW | (os.RTLD_DEEPBIND if is_mapped(_LLVM) else 0)
    for path in triton_libraries():
        # A build that cannot be loaded here harms nobody.
        with contextlib.suppress(OSError):
            ctypes.CDLL(str(path), mode=mode)


@functools.cache
def triton_libraries() -> tuple[Path, ...]:
    """Returns the files of triton's library; none where it is not installed."""
    try:
        spec = importlib.util.find_spec("triton")
    except ValueError:  # A stand-in without a specification is imported.
        spec = None
    folders = (spec and spec.submodule_search_locations) or ()
    return tuple(path for folder in folders for path in Path(folder, "_C").glob("libtriton*.so"))


def signal_beside_triton(library: str) -> int:
    """Returns the signal that ends a program which opens a GL library and then imports triton; 0 if it is not ended."""
    return max(0, -_run(f"{_RENDER_ONE_FRAME}; import triton", library))


def is_mapped(*names: str) -> bool:
    """Returns whether the process has opened a library whose name contains one of `names`; False where unknown."""
    try:
        maps = _MAPS.read_text("utf-8", "replace")
    except OSError:
        return False
    return any(name in maps for name in names)


def is_open() -> bool:
    """Returns whether a driver of a GL library is open in this process."""
    return is_mapped(*_DRIVERS)


def note_opened_by_others() -> None:
    """Makes up, as far as possible, for a GL library that other code opened before the suite was imported."""
    global _process_of_others
    _process_of_others = os.getpid()
    load_triton()


def check_process() -> None:
    """Raises a RuntimeError if a process from which this one was forked has rendered: a GL call would never return."""
    if _processes - {os.getpid()}:
        raise RuntimeError(_after_fork("rendered"))


def _reason(library: str) -> str:
    """Returns why a library cannot be used: some drivers, once opened, render in no process forked after that."""
    return _advice(library) if _process_of_others in (None, os.getpid()) else _after_fork("loaded it")


def _after_fork(done: str) -> str:
    return (
        "nothing can be rendered here: threads of the GL library do not survive a fork, and the process that this one "
        f"was forked from has {done}; start processes with the method 'spawn' or 'forkserver'"
    )


def _leave_display() -> None:
    """Lets a forked process exit without GL calls on what it inherited: some never return."""
    if egl := sys.modules.get("OpenGL.EGL"):
        atexit.unregister(egl.eglTerminate)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_display)


def check_window() -> None:
    """Raises a RuntimeError unless a window can be shown. Without a display, Gymnasium's window ends the process."""
    if _has_window_system():
        import glfw

        if glfw.get_primary_monitor():
            return
    raise RuntimeError(
        "render_mode 'human' shows a window, but there is no display here; use 'rgb_array', or a virtual display "
        "(Debian: xvfb-run)"
    )


def has_display() -> bool:
    """Returns whether there may be a display: on Linux, whether X11 or Wayland names one."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


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


def _advice(library: str) -> str:
    if library == "glfw":
        return (
            f"nothing can be rendered here with {_VARIABLE}=glfw: it needs a display (Debian: xvfb-run); leave "
            f"{_VARIABLE} unset to let a library be found that needs none"
        )
    return (
        f"nothing can be rendered here with {_VARIABLE}={library}: install a GL library (Debian: "
        f"libegl1 libgl1-mesa-dri, or libosmesa6), and leave {_VARIABLE} unset to let it be found"
    )


@contextlib.contextmanager
def variable(value: str) -> Iterator[None]:
    """Context in which `MUJOCO_GL` has a value."""
    given = os.environ.get(_VARIABLE)
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
    return _run(_RENDER_ONE_FRAME, library) == 0


def _run(program: str, library: str) -> int:
    """Runs a program in another process, with a GL library; returns how it ended."""
    environment = {**os.environ, _VARIABLE: library}
    return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True).returncode


def installed_library() -> str | None:
    """Returns the first library that can be loaded; renders nothing, so that it takes milliseconds."""
    candidates = ("glfw", *_HEADLESS_LIBRARIES) if has_display() else _HEADLESS_LIBRARIES
    return next((library for library in candidates if _IS_INSTALLED[library]()), None)


def _has_egl_display() -> bool:
    """Returns whether EGL has a headless display."""
    egl = _load("libEGL.so.1") if _pyopengl_takes("egl") else None
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


def _has_osmesa() -> bool:
    return _pyopengl_takes("osmesa") and any(_load(f"libOSMesa.so{version}") for version in (".8", ".6", ""))


def _has_window_system() -> bool:
    if not has_display():
        return False
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bool(glfw.init())


# By name.
_IS_INSTALLED: Mapping[str, Callable[[], bool]] = {
    "egl": _has_egl_display,
    "osmesa": _has_osmesa,
    "glfw": _has_window_system,
}


def _pyopengl_takes(library: str) -> bool:
    """Returns whether PyOpenGL, which calls EGL and OSMesa, has not been set to another library."""
    return os.environ.get(_PYOPENGL, "").lower() in ("", library)


def _load(name: str) -> ctypes.CDLL | None:
    try:
        return ctypes.CDLL(name)
    except OSError:
        return None

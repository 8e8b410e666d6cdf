"""GL contexts that any thread may use, one after the other, and that leave those of other code as they are."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import collections
import contextlib
import ctypes
import functools
import importlib
import os
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import mujoco

from kitchen_suite.rendering import gl


class Context:
    """A GL context with the objects that MuJoCo made of a model in it; `new_context` makes one.

    Between images it is current in no thread, so that any may use or free it. To dm_control it is both the `gl` and
    the `mujoco` of an engine's `Contexts`.
    """

    def __init__(self, library: str, width: int, height: int) -> None:
        """Makes the GL context, with a library of `gl.opening`."""
        self._resources = _Resources(library, width, height)
        self._lock = threading.RLock()
        # The collector runs in any thread, and in the middle of anything: it must make no GL call.
        weakref.finalize(self, _dropped.append, self._resources).atexit = False

    def hold(self, objects: mujoco.MjrContext) -> None:
        """Takes over the objects that MuJoCo has made in this context, which are freed in it."""
        self._resources.objects = objects

    @property
    def ptr(self) -> mujoco.MjrContext | None:
        """MuJoCo's objects, by the name that dm_control has for them."""
        return self._resources.objects

    @contextlib.contextmanager
    def make_current(self) -> Iterator["Context"]:
        """Context in which GL calls of this thread are for this GL context.

        Raises:
          RuntimeError: the process was forked from one that has rendered.
        """
        gl.check_process()
        with self._lock, self._resources.current():
            yield self

    def call(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """Calls a function: dm_control makes its GL calls so."""
        return function(*args, **kwargs)

    def to_pixels(self, buffer: Any) -> Any:
        """Returns an image `(height, width, ...)` with the first row at the top, for dm_control."""
        return buffer[::-1]

    def free(self) -> None:
        """Frees the GL context and what is in it, once."""
        with self._lock:
            self._resources.free()


@contextlib.contextmanager
def new_context(width: int, height: int) -> Iterator[Context]:
    """Makes a GL context for images of up to a size [pixels]; it is current within the `with` statement.

    Raises:
      RuntimeError: no image can be rendered; the message says why, and what to do.
    """
    _free_dropped()
    with gl.opening() as library:
        context = Context(library, width, height)
        try:
            with context.make_current():
                yield context
        except BaseException:
            context.free()
            raise


class _Resources:
    """The GL objects of a context, kept alive until they are freed: the collector would make GL calls for them."""

    def __init__(self, library: str, width: int, height: int) -> None:
        self._library = library
        self._process = os.getpid()
        self.objects: mujoco.MjrContext | None = None
        with _left_as_it_was(library):
            self._gl = importlib.import_module(f"mujoco.{library}").GLContext(width, height)
        _alive.add(self)

    @contextlib.contextmanager
    def current(self) -> Iterator[None]:
        with _left_as_it_was(self._library):
            self._gl.make_current()
            yield

    def free(self) -> None:
        # What a forked process inherited, it must not touch.
        if self not in _alive or self._process != os.getpid():
            return
        _alive.discard(self)
        if self.objects is not None:
            with self.current():
                self.objects.free()
        with _left_as_it_was(self._library):
            self._gl.free()
            # MuJoCo's frees itself once more when it is collected.
            del self._gl


_alive: set[_Resources] = set()
_dropped: collections.deque[_Resources] = collections.deque()

# Kept also when the interpreter ends, where the values of modules are destroyed: the system frees them then.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(_alive))


def _free_dropped() -> None:
    """Frees what the collector found."""
    while _dropped:
        # Another thread may have been faster.
        with contextlib.suppress(IndexError):
            _dropped.popleft().free()


@contextlib.contextmanager
def _left_as_it_was(library: str) -> Iterator[None]:
    """Context after which this thread's GL context is the one before: dm_control, for example, relies on its own."""
    restore = _CURRENT[library]()
    try:
        yield
    finally:
        restore()


def _current_egl() -> Callable[[], Any]:
    """Returns a function that makes the present context of EGL current again."""
    from mujoco import egl

    nothing = (egl.EGL.EGL_NO_SURFACE, egl.EGL.EGL_NO_SURFACE, egl.EGL.EGL_NO_CONTEXT)
    context = egl.EGL.eglGetCurrentContext()
    if context:
        display = egl.EGL.eglGetCurrentDisplay()
        surfaces = (egl.EGL.eglGetCurrentSurface(which) for which in (egl.EGL.EGL_DRAW, egl.EGL.EGL_READ))
        return functools.partial(egl.EGL.eglMakeCurrent, display, *surfaces, context)
    # There is no display before the first context has been made.
    return lambda: egl.EGL_DISPLAY is not None and egl.EGL.eglMakeCurrent(egl.EGL_DISPLAY, *nothing)


def _current_osmesa() -> Callable[[], Any]:
    # It sets PyOpenGL to OSMesa before it imports it.
    from mujoco.osmesa import GL, osmesa

    context = osmesa.OSMesaGetCurrentContext()
    if not context:
        return lambda: osmesa.OSMesaMakeCurrent(None, None, GL.GL_FLOAT, 0, 0)
    width, height, _, buffer = osmesa.OSMesaGetColorBuffer(context)
    # MuJoCo and dm_control both draw into arrays of this type.
    return functools.partial(osmesa.OSMesaMakeCurrent, context, buffer, GL.GL_FLOAT, width, height)


def _current_glfw() -> Callable[[], Any]:
    import glfw

    window = glfw.get_current_context()
    make_current: Callable[[Any], Any] = glfw.make_context_current
    return functools.partial(make_current, window or None)


_CURRENT: Mapping[str, Callable[[], Callable[[], Any]]] = {
    "egl": _current_egl,
    "osmesa": _current_osmesa,
    "glfw": _current_glfw,
}

"""Importing this module imports MuJoCo and dm_control without opening a GL library.

Both choose a library when they are imported, and dm_control opens its driver then, for programs without images as well.
Mesa's driver brings LLVM, beside which PyTorch's triton ends the process (`gl.load_triton`). So the modules that import
either one import this module before. Here both are told that rendering is disabled, and what they would have chosen is
chosen when it is first asked for: also for programs that render with MuJoCo or dm_control alone, after the suite.
"""

import importlib
import importlib.util
import sys
from types import ModuleType
from typing import Any

from kitchen_suite.rendering import gl


def _import_lazily(name: str) -> None:
    """Imports a module whose code runs when an attribute of it is first asked for.

    `importlib.util.LazyLoader` runs it when the module is imported once more, by Python's own look at its attributes.
    """
    spec = importlib.util.find_spec(name)
    if name in sys.modules or spec is None or spec.loader is None:
        return
    module = importlib.util.module_from_spec(spec)
    run = spec.loader.exec_module

    def load(attribute: str) -> Any:
        vars(module).pop("__getattr__", None)
        run(module)
        return getattr(module, attribute)

    module.__getattr__ = load  # type: ignore[method-assign]
    sys.modules[name] = module


def _choose_at_first_use(name: str, chosen: tuple[str, ...], *aliases: str) -> None:
    """Lets a module, and others that have its names too, choose the GL library when a name in `chosen` is first used.

    The module then runs once more, as it would have run with this library.
    """
    module = importlib.import_module(name)
    modules = [module, *map(importlib.import_module, aliases)]

    def choose(attribute: str) -> Any:
        if attribute not in chosen:
            raise AttributeError(f"module {name!r} has no attribute {attribute!r}")
        with gl.opening() as library, gl.variable(library):
            importlib.reload(module)
        for each in modules:
            vars(each).update({known: vars(module)[known] for known in chosen})
        return vars(module)[attribute]

    for each in modules:
        for known in chosen:
            vars(each).pop(known, None)
        each.__getattr__ = choose  # type: ignore[method-assign]


def _import_without_gl(name: str, *aliases: str, chosen: tuple[str, ...]) -> None:
    """Imports a module that chooses a GL library, and has it choose at first use.

    It also chooses anew where other code imported it before: where there is no display, it may have chosen a window.
    """
    before = sys.modules.get(name)
    with gl.variable("disable"):
        importlib.import_module(name)
    if before is None or (_has_windows(before) and not gl.has_display()):
        _choose_at_first_use(name, chosen, *aliases)


def _has_windows(module: ModuleType) -> bool:
    """Returns whether a module chose GLFW, or found nothing."""
    backend = vars(module).get("BACKEND", vars(module).get("GLContext"))
    return backend in ("glfw", None) or getattr(backend, "__module__", "") == "mujoco.glfw"


if gl.is_open():
    gl.note_opened_by_others()
# Gymnasium's renderer, which gymnasium-robotics imports, opens GLFW's library.
_import_lazily("glfw")
_import_without_gl("mujoco.rendering.classic.gl_context", "mujoco", "mujoco.gl_context", chosen=("GLContext",))
_import_without_gl("dm_control._render", chosen=("BACKEND", "Renderer", "USING_GPU"))

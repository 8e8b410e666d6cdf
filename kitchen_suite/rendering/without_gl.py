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

# What they define by the library that they chose.
_OF_DM_CONTROL = ("BACKEND", "Renderer", "USING_GPU")
_OF_MUJOCO = ("GLContext",)

_DM_CONTROL = "dm_control._render"
_MUJOCO = "mujoco.rendering.classic.gl_context"


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
    module = sys.modules[name]
    modules = [module, *(importlib.import_module(alias) for alias in aliases)]

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


def _chose_a_window(render: ModuleType) -> bool:
    """Returns whether dm_control, imported before the suite, chose GLFW where there is no display."""
    return vars(render).get("BACKEND") in ("glfw", None) and not gl.has_display()


if gl.is_open():
    gl.note_opened_by_others()
# Gymnasium's renderer, which gymnasium-robotics imports, opens GLFW's library.
_import_lazily("glfw")
with gl.variable("disable"):
    if "mujoco" not in sys.modules:
        importlib.import_module(_MUJOCO)
        _choose_at_first_use(_MUJOCO, _OF_MUJOCO, "mujoco", "mujoco.gl_context")
    if _DM_CONTROL not in sys.modules:
        importlib.import_module(_DM_CONTROL)
        _choose_at_first_use(_DM_CONTROL, _OF_DM_CONTROL)
if _chose_a_window(sys.modules[_DM_CONTROL]):
    _choose_at_first_use(_DM_CONTROL, _OF_DM_CONTROL)

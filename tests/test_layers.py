"""Imports go one way between the packages, without circles, and the heavy libraries stay in their package."""

import ast
import graphlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# Each package knows those after it. All know GROUND, which knows no other; RENDERING knows hardly more.
ORDER = (
    "commands",
    "lerobot",
    "doctor",
    "viewer",
    "adapters",
    "training",
    "evaluation",
    "datasets",
    "episodes",
    "vector_env",
    "gymnasium_env",
    "policies",
    "suite",
    "agreement",
    "domains",
    "environment",
    "tasks",
    "entities",
)
GROUND = (
    *("", "_version", "checks", "closing", "files", "imports", "installation"),
    *("environment_classes", "kitchen_tasks", "lazy", "physics_names", "signatures", "types", "versions"),
)
BESIDE = {"rendering": ()}
# For users: `kitchen_suite.experts`, `kitchen_suite.load` and `python -m kitchen_suite`.
ALIASES = {
    "experts": ("policies",),
    "": ("suite",),
    "__main__": ("commands",),
    "original": ("suite", "rendering"),
}

# Where a library may be imported.
HOMES = {
    "absl": {"commands"},
    "torch": {"training"},
    "ray": {"episodes"},
    "minari": {"datasets"},
    "stable_baselines3": {"adapters"},
    "lerobot": {"lerobot"},
    "mjviser": {"viewer"},
    "viser": {"viewer"},
    "tensordict": {"adapters"},
    "torchrl": {"adapters"},
}


def modules():
    """All modules of the package by dotted name below `kitchen_suite`, with their syntax trees."""
    # Links are not followed.
    files = {path: path.relative_to(ROOT / "kitchen_suite") for path in (ROOT / "kitchen_suite").rglob("*.py")}
    files |= {
        path: path.relative_to(ROOT) for folder in ("entities", "tasks") for path in (ROOT / folder).rglob("*.py")
    }
    return {
        ".".join(name.with_suffix("").parts).removesuffix("__init__").removesuffix("."): ast.parse(
            path.read_text("utf-8")
        )
        for path, name in files.items()
    }


MODULES = modules()


def package(module):
    return module.partition(".")[0]


def imported_names(tree):
    """Dotted names that a module imports, also inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def dependencies(module):
    """Modules of the suite that a module imports.

    What the package itself names for type checkers alone is imported when it is first used.
    """
    tree = MODULES[module]
    if not module:
        tree = ast.Module([node for node in tree.body if not isinstance(node, ast.If)], [])
    found = set()
    for name in imported_names(tree):
        top, _, inner = name.partition(".")
        if top == "kitchen_suite":
            while inner not in MODULES:
                inner = inner.rpartition(".")[0]
            found.add(inner)
    return found - {module}


def allowed(name):
    if name in ORDER:
        return {*ORDER[ORDER.index(name) :], *BESIDE, *GROUND}
    if name in GROUND and name not in ALIASES:
        return {*GROUND}
    return {name, *BESIDE.get(name, ALIASES.get(name, ())), *GROUND}


def test_every_package_has_its_layer():
    assert {package(module) for module in MODULES} == {*ORDER, *GROUND, *BESIDE, *ALIASES}


@pytest.mark.parametrize("module", MODULES)
def test_a_module_imports_only_what_its_layer_may_know(module):
    known = {package(found) for found in dependencies(module)}
    assert known <= allowed(package(module)), sorted(known - allowed(package(module)))


def test_no_modules_import_each_other_in_a_circle():
    graph = {module: dependencies(module) for module in MODULES}
    assert list(graphlib.TopologicalSorter(graph).static_order())


@pytest.mark.full
@pytest.mark.parametrize("library", HOMES)
def test_a_heavy_library_stays_in_its_package(library):
    homes = {
        package(module)
        for module, tree in MODULES.items()
        if any(name.partition(".")[0] == library for name in imported_names(tree))
    }
    assert homes <= HOMES[library]


@pytest.mark.full
def test_no_command_imports_dm_control_before_the_gl_library_is_chosen():
    code = (
        "import sys; from kitchen_suite.commands import NAMES, find\n"
        "assert len(NAMES) >= 10 and all(find(name).main(['--help']) == 0 for name in NAMES)\n"
        "assert not {'dm_control', 'mujoco', 'torch', 'ray'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


# Libraries that open a GL library when they are imported, unless `rendering.without_gl` is imported before.
OPENERS = ("dm_control", "glfw", "gymnasium.envs.mujoco", "gymnasium_robotics", "mink", "mjviser", "mujoco")


def test_no_module_opens_a_gl_library():
    """Each module that imports one of these imports `without_gl` before, or is in a package that does."""
    for module, tree in MODULES.items():
        names = [
            name
            for node in tree.body
            if isinstance(node, ast.Import | ast.ImportFrom)
            for name in (*imported_names(ast.Module([node], [])), getattr(node, "module", None) or "")
        ]
        opens = [name.startswith(OPENERS) for name in names]
        prepares = ["without_gl" in name for name in names]
        of_package = any("rendering.without_gl" in dependencies(each) for each in parents(module))
        if any(opens) and module != "rendering.without_gl" and not of_package:
            assert any(prepares), module
            assert prepares.index(True) < opens.index(True), module


def parents(module):
    """The packages that are imported before a module."""
    parts = module.split(".")
    return [".".join(parts[:count]) for count in range(1, len(parts))]

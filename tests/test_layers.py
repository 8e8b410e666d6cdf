"""Imports go one way between the packages, without circles, and the heavy libraries stay in their package."""

import ast
import graphlib
import subprocess
import sys

import pytest
from helpers.modules import HOMES, ROOT, imported_names, modules, stated_names

# Each package knows those after it. All know GROUND, which knows no other; RENDERING knows hardly more.
ORDER = (
    "commands",
    "doctor",
    "viewer",
    "adapters",
    "training",
    "evaluation",
    "datasets",
    "lerobot",
    "episodes",
    "vector_env",
    "gymnasium_env",
    "policies",
    "suite",
    "agreement",
    "energy",
    "grasping",
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

# Their tables name, by strings, what is in packages above them, and is imported when it is first used.
TABLES = ("", "environment_classes", "domains")


def package(module):
    return module.partition(".")[0]


def dependencies(module):
    """Modules of the suite that a module imports.

    What the package itself names, for type checkers and in its table, is imported when it is first used.
    """
    tree = modules()[module]
    if not module:
        tree = ast.Module([node for node in tree.body if not isinstance(node, ast.If)], [])
    found = set()
    for name in stated_names(tree) if package(module) in TABLES else imported_names(tree):
        top, _, inner = name.partition(".")
        if top == "kitchen_suite":
            while inner not in modules():
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
    assert {package(module) for module in modules()} == {*ORDER, *GROUND, *BESIDE, *ALIASES}


def test_a_module_imports_only_what_its_layer_may_know():
    known = {module: {package(found) for found in dependencies(module)} for module in modules()}
    further = {module: sorted(found - allowed(package(module))) for module, found in known.items()}
    assert {module: found for module, found in further.items() if found} == {}


def test_no_modules_import_each_other_in_a_circle():
    graph = {module: dependencies(module) for module in modules()}
    assert list(graphlib.TopologicalSorter(graph).static_order())


def homes(trees):
    """Packages that import each heavy library."""
    found = {library: set() for library in HOMES}
    for module, tree in trees.items():
        for library in {name.partition(".")[0] for name in imported_names(tree)} & found.keys():
            found[library].add(package(module))
    return found


def test_heavy_libraries_stay_in_their_packages():
    assert homes(modules()) == HOMES


@pytest.mark.parametrize(
    "code",
    [
        "import importlib\ndef f():\n    return importlib.import_module('torch.nn')",
        "import importlib\nname = 'nn'\nnn = importlib.import_module(f'torch.{name}')",
        "torch = __import__('torch')",
        "import pkgutil\nModule = pkgutil.resolve_name('torch.nn:Module')",
        "LAZY = {'Module': 'torch.nn:Module'}",
        "LAZY = ('torch:',)",
    ],
)
def test_an_import_by_a_string_is_found(code):
    assert homes({"tasks.hidden": ast.parse(code)})["torch"] == {"tasks"}


@pytest.mark.parametrize("text", ["kitchen_suite.training.ppo:train", "kitchen_suite.training:"])
def test_an_entry_point_in_a_package_above_is_found(text, monkeypatch):
    monkeypatch.setitem(modules(), "tasks.hidden", ast.parse(f"LAZY = {{'train': {text!r}}}"))
    with pytest.raises(AssertionError):
        test_a_module_imports_only_what_its_layer_may_know()


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
    for module, tree in modules().items():
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

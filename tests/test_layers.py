"""Imports go one way between the packages, without circles, and the heavy libraries stay in their package."""

import ast
import graphlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

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
    "domains",
    "environment",
    "tasks",
    "entities",
)
GROUND = (
    *("", "_version", "checks", "closing", "files", "imports", "installation"),
    *("lazy", "names", "signatures", "types", "versions"),
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
TABLES = ("", "names", "domains")

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


# An entry point in a table, such as `torch.nn:Module`, or of a module alone, as `kitchen_suite.tasks:`.
ENTRY_POINT = re.compile(r"([a-z_]\w*(?:\.\w+)*):(\w*(?:\.\w+)*)")
TOPS = ("kitchen_suite", *HOMES)

# What imports by a name; tests/test_doors.py has the modules that may do so by a name that is no literal.
IMPORTERS = ("import_module", "__import__", "resolve_name")


def literal_start(node):
    """The text of a literal, or the one that an f-string begins with; empty for another expression."""
    if isinstance(node, ast.JoinedStr):
        node = node.values[0]
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def named_by_strings(tree):
    """Dotted names that a module imports by strings: in a call, or as entry points in a table, which another resolves.

    All entry points of the suite and of the heavy libraries are taken for imports, wherever they stand.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in IMPORTERS:
            yield literal_start(node.args[0]).replace(":", ".").rstrip(".")
        elif (match := ENTRY_POINT.fullmatch(literal_start(node))) and match[1].partition(".")[0] in TOPS:
            yield ".".join(filter(None, match.groups()))


def imported_names(tree):
    """Dotted names that a module imports, also inside functions and by strings."""
    yield from named_by_strings(tree)
    yield from stated_names(tree)


def stated_names(tree):
    """Dotted names in the import statements of a module, also inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def dependencies(module):
    """Modules of the suite that a module imports.

    What the package itself names, for type checkers and in its table, is imported when it is first used.
    """
    tree = MODULES[module]
    if not module:
        tree = ast.Module([node for node in tree.body if not isinstance(node, ast.If)], [])
    found = set()
    for name in stated_names(tree) if package(module) in TABLES else imported_names(tree):
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


def homes(library, modules=MODULES):
    """Packages that import a library."""
    return {
        package(module)
        for module, tree in modules.items()
        if any(name.partition(".")[0] == library for name in imported_names(tree))
    }


@pytest.mark.full
@pytest.mark.parametrize("library", HOMES)
def test_a_heavy_library_stays_in_its_package(library):
    assert homes(library) <= HOMES[library]


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
    assert homes("torch", {**MODULES, "tasks.hidden": ast.parse(code)}) - HOMES["torch"] == {"tasks"}


@pytest.mark.parametrize("text", ["kitchen_suite.training.ppo:train", "kitchen_suite.training:"])
def test_an_entry_point_in_a_package_above_is_found(text, monkeypatch):
    monkeypatch.setitem(MODULES, "tasks.hidden", ast.parse(f"LAZY = {{'train': {text!r}}}"))
    with pytest.raises(AssertionError):
        test_a_module_imports_only_what_its_layer_may_know("tasks.hidden")


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

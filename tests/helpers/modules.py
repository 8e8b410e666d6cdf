"""The modules of the package as syntax trees, and what they import."""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent

# What imports by a name; tests/test_doors.py has the modules that may do so by a name that is no literal.
_IMPORTERS = ("import_module", "__import__", "resolve_name")

# An entry point in a table, such as `torch.nn:Module`, or of a module alone, as `kitchen_suite.tasks:`.
_ENTRY_POINT = re.compile(r"([a-z_]\w*(?:\.\w+)*):(\w*(?:\.\w+)*)")

# Heavy libraries, and the packages that may import them.
HOMES = {
    "absl": {"commands"},
    "torch": {"lerobot", "training"},
    "ray": {"episodes"},
    "minari": {"datasets"},
    "stable_baselines3": {"adapters"},
    "lerobot": {"lerobot"},
    "mjviser": {"viewer"},
    "viser": {"viewer"},
    "tensordict": {"adapters"},
    "torchrl": {"adapters"},
}

_TOPS = ("kitchen_suite", *HOMES)


@functools.cache
def modules() -> dict[str, ast.Module]:
    """Returns all modules of the package by dotted name below `kitchen_suite`, with their syntax trees."""
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


def imported_names(tree: ast.AST) -> Iterator[str]:
    """Yields the dotted names that a module imports, also inside functions and by strings."""
    yield from _named_by_strings(tree)
    yield from stated_names(tree)


def stated_names(tree: ast.AST) -> Iterator[str]:
    """Yields the dotted names in the import statements of a module, also inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _named_by_strings(tree: ast.AST) -> Iterator[str]:
    """Yields dotted names that a module imports by strings: in a call, or as entry points in a table.

    All entry points of the suite and of the heavy libraries are taken for imports, wherever they stand.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in _IMPORTERS:
            yield _literal_start(node.args[0]).replace(":", ".").rstrip(".")
        elif (match := _ENTRY_POINT.fullmatch(_literal_start(node))) and match[1].partition(".")[0] in _TOPS:
            yield ".".join(filter(None, match.groups()))


def _literal_start(node: ast.AST) -> str:
    """Returns the text of a literal, or the one that an f-string begins with; empty for another expression."""
    if isinstance(node, ast.JoinedStr):
        node = node.values[0]
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""

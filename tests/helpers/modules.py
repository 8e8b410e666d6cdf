"""The modules of the package as syntax trees, and what they import."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent

# Functions that import what their first argument names.
_IMPORTERS = ("import_module", "__import__", "resolve_name")


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
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=aliases):
                yield from (alias.name for alias in aliases)
            case ast.ImportFrom(module=module, names=aliases, level=level):
                assert not level, "imports are absolute"
                yield from (f"{module}.{alias.name}" for alias in aliases)
            case ast.Call(
                func=ast.Name(id=function) | ast.Attribute(attr=function),
                args=[ast.Constant(value=str(name)) | ast.JoinedStr(values=[ast.Constant(value=str(name)), *_]), *_],
            ) if function in _IMPORTERS:
                yield name.replace(":", ".").rstrip(".")

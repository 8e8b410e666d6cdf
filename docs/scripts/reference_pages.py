"""The pages of the site's reference: every public name, from its docstring, and the help of every command."""

import ast
import contextlib
import importlib
import importlib.util
import io
from pathlib import Path

import kitchen_suite
from kitchen_suite import commands

ROOT = Path(__file__).resolve().parents[2]


def modules() -> list[str]:
    """Returns the public modules by dotted name: the package, and the modules that tab completion offers of it."""
    names = [f"kitchen_suite.{name}" for name in sorted(dir(kitchen_suite))]
    return ["kitchen_suite", *(name for name in names if importlib.util.find_spec(name))]


def public_names(module: str) -> list[str]:
    """Returns the dotted names of what a module offers, submodules left out: they have pages of their own."""
    names = [f"{module}.{name}" for name in _exported(module)]
    return [name for name in names if name not in modules()]


def _exported(module: str) -> list[str]:
    """Returns `__all__`; where it is a list of literals, without importing the module, which may need an extra."""
    source = Path(importlib.util.find_spec(module).origin).read_text(encoding="utf-8")
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            with contextlib.suppress(ValueError):
                return ast.literal_eval(node.value)
    return importlib.import_module(module).__all__


def pages() -> dict[str, str]:
    """Returns the texts of all pages of the reference by file name."""
    pages = {f"reference/{module}.md": _module_page(module) for module in modules()}
    return {"reference/index.md": _index(), "reference/commands.md": _commands(), **pages}


def _module_page(module: str) -> str:
    own = f"::: {module}\n    options: {{members: false, heading_level: 1, show_root_full_path: true}}"
    return "\n\n".join([own, *(f"::: {name}" for name in public_names(module))]) + "\n"


def _index() -> str:
    lines = ["# Reference", "", "Every public name, from its docstring.", "", "| module | names |", "| --- | --- |"]
    for module in modules():
        names = ", ".join(f"[`{name.rpartition('.')[2]}`][{name}]" for name in public_names(module))
        lines.append(f"| [`{module}`]({module}.md) | {names} |")
    return "\n".join([*lines, "", "[Commands](commands.md) has the help of each command.", ""])


def _commands() -> str:
    sections = ["# Commands", "The output of each command with `--help`."]
    mains = {"kitchen-suite": commands.main, **{f"kitchen-{name}": commands.find(name).main for name in commands.NAMES}}
    for name, main in mains.items():
        with contextlib.redirect_stdout(io.StringIO()) as output:
            main(["--help"])
        sections.append(f"## {name}\n\n```text\n{output.getvalue()}```")
    return "\n\n".join(sections) + "\n"

"""Loads the Python files below docs/ for their tests."""

import importlib.util
import sys
from pathlib import Path
from unittest import mock

DOCS = Path(__file__).resolve().parent.parent / "docs"


def load_script(name):
    """Returns a file such as "scripts/tables" as a new module; it finds the files beside it, as when it is run."""
    path = DOCS / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"docs_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    with mock.patch.object(sys, "path", [str(path.parent), *sys.path]):
        spec.loader.exec_module(module)
    return module

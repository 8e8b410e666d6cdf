"""Trees of the suite: this one and those of earlier revisions, and what a process needs to run the code of one."""

import configparser
import contextlib
import io
import os
import pkgutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def extract(revision: str, folder: Path) -> Path:
    """Writes the tree of a revision of this repository to a folder; returns the folder."""
    folder.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def commit(revision: str) -> str:
    """Returns the full hash of a revision."""
    command = ["git", "rev-parse", "--verify", f"{revision}^{{commit}}"]
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def environ(tree: Path) -> Mapping[str, str]:
    """Environment variables of a process that imports the suite from a tree."""
    return {"MUJOCO_GL": "disable", **os.environ, "PYTHONPATH": str(tree)}


def use(tree: Path) -> None:
    """Makes this process import the suite from a tree."""
    os.environ.update(environ(tree))
    sys.path.insert(0, str(tree))
    import kitchen_suite

    assert Path(str(kitchen_suite.__file__)).resolve().is_relative_to(tree.resolve()), kitchen_suite.__file__


def run_command(tree: Path, name: str, *arguments: str) -> str:
    """Runs a console script of a tree in this process; returns what it prints."""
    setup = configparser.RawConfigParser()
    setup.read(tree / "setup.cfg", encoding="utf-8")
    scripts = dict(line.split(" = ") for line in setup["options.entry_points"]["console_scripts"].strip().splitlines())
    # Installed beside the package, but in its folder.
    entry_point = scripts[name].replace("kitchen_suite_console", "kitchen_suite.console")
    main, argv = pkgutil.resolve_name(entry_point), sys.argv
    try:
        sys.argv = [name, *arguments]
        with contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO(), encoding="utf-8")) as output:
            status = main()
    except SystemExit as ending:
        status = ending.code
    finally:
        sys.argv = argv
    output.seek(0)
    printed = output.read()
    assert not status, (name, arguments, status, printed)
    return printed

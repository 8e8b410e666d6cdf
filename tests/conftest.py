"""Chooses a GL library before MuJoCo is imported; where there is none, deselects the rendering tests and warns."""

import ctypes.util
import gc
import os
import re
import socket

import pytest

_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_ADVICE = "install a GL library (Debian: libegl1 libgl1-mesa-dri, or libosmesa6) to run them"
_DESELECTED = pytest.StashKey[int]()

if "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = next(
        (backend for backend, name in _LIBRARIES.items() if ctypes.util.find_library(name)), "disable"
    )


# MJCF models consist of many small objects: at Python's default thresholds, garbage collection takes a quarter of the
# time in which a kitchen is built.
gc.set_threshold(500_000, 5, 20)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if os.environ["MUJOCO_GL"] != "disable":
        return
    deselected = [item for item in items if item.get_closest_marker("rendering")]
    items[:] = [item for item in items if item not in deselected]
    config.hook.pytest_deselected(items=deselected)
    config.stash[_DESELECTED] = len(deselected)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if count := config.stash.get(_DESELECTED, 0):
        terminalreporter.write_line(f"WARNING: {count} rendering tests were left out; {_ADVICE}", yellow=True)


@pytest.fixture
def port():
    """A port of this machine that no program uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The present folder, empty, with a folder for Minari's datasets of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return tmp_path


@pytest.fixture
def run(capsys):
    """Runs a command in this process; returns its status, stdout and stderr."""

    def run(command, *arguments):
        capsys.readouterr()
        return command.main([*arguments]), *capsys.readouterr()

    return run


@pytest.fixture
def refusal(run):
    """Runs a command that refuses what it is given; returns the one line that it writes to stderr."""

    def refusal(command, *arguments, status=2):
        found, _, error = run(command, *arguments)
        assert found == status
        assert re.fullmatch(r"kitchen-\w+: [^\n]+\n", error), error
        return error

    return refusal

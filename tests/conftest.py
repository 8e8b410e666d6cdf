"""Chooses a GL library before MuJoCo is imported, and which tests are run: by their cost, and by what is here.

A chosen test that needs what is not here is deselected, and the summary says so; with --complete the run fails.
"""

import collections
import ctypes.util
import gc
import importlib.util
import os
import re
import socket
import sys
from collections.abc import Generator
from typing import Any

import pytest

_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_GL = "a GL library"
_ADVICE = "Debian has one in libegl1 and libgl1-mesa-dri, or in libosmesa6"
_LACKING = pytest.StashKey[collections.Counter[str]]()

if "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = next(
        (backend for backend, name in _LIBRARIES.items() if ctypes.util.find_library(name)), "disable"
    )


# MJCF models consist of many small objects: at Python's default thresholds, garbage collection takes a quarter of the
# time in which a kitchen is built.
gc.set_threshold(500_000, 5, 20)


COSTS = ("quick", "full", "nightly")

# What the tests of a marker import. Tests that need any of it cost as much as the full ones.
REQUIREMENTS = {
    "clients": ("torch", "stable_baselines3", "sb3_contrib", "skrl", "torchrl", "shimmy", "ipykernel", "matplotlib"),
    "torch": ("torch", "stable_baselines3"),
    "ray": ("ray",),
    "lerobot": ("lerobot",),
    "web": ("viser", "mjviser"),
    "browser": ("viser", "playwright"),
    "vla_eval": ("vla_eval",),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--run", choices=COSTS, default=COSTS[0], help="which tests to run, by what they cost")
    parser.addoption("--complete", action="store_true", help="fail if a chosen test needs what is not here")


def _cost(item: pytest.Item) -> int:
    """Returns the place of a test's cost in `COSTS`."""
    if item.get_closest_marker("nightly"):
        return 2
    return int(any(map(item.get_closest_marker, ("full", "loaders", *REQUIREMENTS))))


def _missing(item: pytest.Item) -> str | None:
    """Returns what a test needs and does not have here; None if it has everything."""
    if item.get_closest_marker("rendering") and os.environ["MUJOCO_GL"] == "disable":
        return _GL
    if item.get_closest_marker("loaders") and "LOADERS_PYTHON" not in os.environ:
        return "LOADERS_PYTHON"
    for marker, modules in REQUIREMENTS.items():
        if item.get_closest_marker(marker):
            for module in modules:
                if importlib.util.find_spec(module) is None:
                    return module
    return None


def _mark_further_cases(items: list[pytest.Item]) -> None:
    """Marks the cases of parametrised tests that a quick run leaves out: it plays the first and the last one.

    Where some cases of a test are marked by hand, as by `helpers.sweeps.brief`, the others are those to be played.
    """
    by_test: dict[str, list[pytest.Item]] = collections.defaultdict(list)
    for item in items:
        by_test[item.nodeid.partition("[")[0]].append(item)
    for cases in by_test.values():
        if not any(map(_cost, cases)):
            for item in cases[1:-1]:
                item.add_marker(pytest.mark.full)


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Generator[None]:
    _mark_further_cases(items)
    # Here pytest chooses by -m and -k: the rest is about those alone, so that nothing is missed that was not asked for.
    yield
    most = COSTS.index(config.getoption("--run"))
    affordable = [item for item in items if _cost(item) <= most]
    lacking = {item: missing for item in affordable if (missing := _missing(item))}
    selected = [item for item in affordable if item not in lacking]
    config.hook.pytest_deselected(items=[*{*items}.difference(selected)])
    config.stash[_LACKING] = collections.Counter(lacking.values())
    items[:] = selected


def pytest_sessionfinish(session: pytest.Session) -> None:
    lacking = session.config.stash.get(_LACKING, collections.Counter())
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["lacking"] = dict(lacking)
    elif lacking and session.config.getoption("--complete"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Keeps what a process of pytest-xdist has left out: all of them collect the same tests."""
    node.config.stash[_LACKING] = collections.Counter(getattr(node, "workeroutput", {}).get("lacking", {}))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    for missing, count in config.stash.get(_LACKING, collections.Counter()).items():
        advice = f"; {_ADVICE}" if missing == _GL else ""
        terminalreporter.write_line(f"WARNING: {count} tests were left out, which need {missing}{advice}", yellow=True)


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
def write_policies(folder, monkeypatch):
    """Writes a module `my_policies` into the present folder, where commands find it."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "my_policies", raising=False)
    yield folder.joinpath("my_policies.py").write_text
    sys.modules.pop("my_policies", None)


@pytest.fixture
def refusal(run):
    """Runs a command that refuses what it is given; returns the one line that it writes to stderr."""

    def refusal(command, *arguments, status=2):
        found, _, error = run(command, *arguments)
        assert found == status
        assert re.fullmatch(r"kitchen-\w+: [^\n]+\n", error), error
        return error

    return refusal

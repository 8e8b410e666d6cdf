"""Which tests a run plays: some cases of each in every run, more in a full one, and all in a nightly one."""

import os
import subprocess
import sys

import pytest
from docs_blocks import ROOT

TESTS = """
import pytest

@pytest.mark.parametrize("case", range(10))
def test_sweep(case):
    pass

@pytest.mark.full
@pytest.mark.parametrize("case", range(9))
def test_full_sweep(case):
    pass

@pytest.mark.parametrize("case", [0, 1, pytest.param(2, marks=pytest.mark.nightly)])
def test_marked(case):
    pass

@pytest.mark.loaders
@pytest.mark.parametrize("case", range(8))
def test_with_a_requirement(case):
    pass

def test_one():
    pass
"""


def collected(folder, run, *arguments):
    """The cases that a run of the tests above plays, by test."""
    folder.joinpath("test_costs_of_these.py").write_text(TESTS)
    folder.joinpath("pytest.ini").write_text("[pytest]\nmarkers =\n full:\n nightly:\n loaders:\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests"), "LOADERS_PYTHON": "python"}
    command = [sys.executable, "-m", "pytest", "-p", "conftest", "-p", "no:cacheprovider", "--collect-only", "-q"]
    process = subprocess.run(
        [*command, f"--run={run}", *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    names = [line.partition("::")[2] for line in process.stdout.splitlines() if "::" in line]
    found = {}
    for name in names:
        test, _, case = name.removesuffix("]").partition("[")
        found.setdefault(test, []).append(int(case or 0))
    return found


@pytest.mark.full
def test_a_run_plays_some_cases_evenly_spread(tmp_path):
    assert collected(tmp_path, "quick") == {"test_sweep": [0, 9], "test_marked": [0, 1], "test_one": [0]}
    full = collected(tmp_path, "full")
    assert {test: len(cases) for test, cases in full.items()} == {
        "test_sweep": 6,
        "test_full_sweep": 6,
        "test_marked": 2,
        "test_with_a_requirement": 8,
        "test_one": 1,
    }
    assert {0, 9} < {*full["test_sweep"]}
    assert full["test_full_sweep"] == [0, 2, 3, 5, 6, 8]


@pytest.mark.full
def test_every_case_is_played_by_one_stage(tmp_path):
    everything = collected(tmp_path, "nightly")
    assert {test: len(cases) for test, cases in everything.items()} == {
        "test_sweep": 10,
        "test_full_sweep": 9,
        "test_marked": 3,
        "test_with_a_requirement": 8,
        "test_one": 1,
    }
    stages = [
        collected(tmp_path, "quick"),
        collected(tmp_path, "full", "-m", "full"),
        collected(tmp_path, "full", "-m", "loaders"),
        collected(tmp_path, "nightly", "-m", "nightly"),
    ]
    for test, cases in everything.items():
        played = [case for stage in stages for case in stage.get(test, [])]
        assert sorted(played) == cases

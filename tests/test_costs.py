"""Which tests a run plays: a quick one some cases of each, and each case is in one stage."""

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

@pytest.mark.parametrize("case", [0, 1, pytest.param(2, marks=pytest.mark.nightly), 3])
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
        test, *case = name.removesuffix("]").split("[")
        found.setdefault(test, []).append(int(*case))
    return found


@pytest.mark.full
def test_a_quick_run_plays_the_first_and_the_last_case(tmp_path):
    assert collected(tmp_path, "quick") == {"test_sweep": [0, 9], "test_marked": [0, 1, 3], "test_one": [0]}


@pytest.mark.full
def test_every_case_is_played_by_one_stage(tmp_path):
    everything = collected(tmp_path, "nightly")
    assert {test: len(cases) for test, cases in everything.items()} == {
        "test_sweep": 10,
        "test_full_sweep": 9,
        "test_marked": 4,
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

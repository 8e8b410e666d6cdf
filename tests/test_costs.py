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


def played(folder, *arguments, here=("LOADERS_PYTHON",)):
    """The process of a run of the tests above, in which some variables are set."""
    folder.joinpath("test_costs_of_these.py").write_text(TESTS)
    folder.joinpath("pytest.ini").write_text("[pytest]\nmarkers =\n full:\n nightly:\n loaders:\n")
    environment = {name: value for name, value in os.environ.items() if name != "LOADERS_PYTHON"}
    environment |= {"PYTHONPATH": str(ROOT / "tests"), **dict.fromkeys(here, "python")}
    command = [sys.executable, "-m", "pytest", "-p", "conftest", "-p", "no:cacheprovider", "-q"]
    return subprocess.run(
        [*command, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def collected(folder, run, *arguments):
    """The cases that a run of the tests above plays, by test."""
    process = played(folder, "--collect-only", f"--run={run}", *arguments)
    assert process.returncode == 0, process.stderr
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


@pytest.mark.full
@pytest.mark.parametrize("processes", [(), ("-n", "2")], ids=["one process", "two processes"])
def test_a_run_that_is_to_be_complete_fails_if_a_chosen_test_is_left_out(tmp_path, processes):
    run = ("--run=full", *processes)
    left_out = "WARNING: 8 tests were left out, which need LOADERS_PYTHON"
    for arguments, status, shown in [
        ((), 0, True),
        (("--complete",), 1, True),
        (("--complete", "-k", "test_one or with_a_requirement"), 1, True),
        # What was not chosen is not missed.
        (("--complete", "-m", "full"), 0, False),
        (("--complete", "-k", "test_one"), 0, False),
    ]:
        process = played(tmp_path, *run, *arguments, here=())
        assert (process.returncode, left_out in process.stdout) == (status, shown), process.stdout
    assert played(tmp_path, *run, "--complete").returncode == 0

"""The benchmark measures what it says, on a very small scale."""

import json
import os
import subprocess
import sys

import pytest

from kitchen_suite import benchmark
from kitchen_suite.benchmark_domains import BARE, DOMAINS


@pytest.mark.parametrize("domain", DOMAINS)
def test_it_prints_a_row_for_every_contender(domain, capsys):
    assert benchmark.main(["kitchen-benchmark", f"--domain_name={domain}", "--rounds=1", "--steps=2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in DOMAINS[domain].contenders():
        (row,) = [line for line in lines if line.startswith(f"{name} ")]
        ratio, least, greatest, rate = map(float, row.removeprefix(name).split())
        assert 0 < least == ratio == greatest
        assert rate > 1
    assert any("Gymnasium adapter adds" in line for line in lines)


def test_json_holds_the_same_and_the_versions(capsys):
    assert benchmark.main(["kitchen-benchmark", "--rounds=1", "--steps=2", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["results"][BARE]["ratio"] == 1.0
    assert {"mujoco", "dm_control", "numpy"} <= result["versions"].keys()


@pytest.mark.parametrize("flags", [["--rounds=0"], ["--rounds=many"], ["--speed"], ["fast"], ["--domain_name=bath"]])
def test_bad_flags_end_with_code_2(flags, capsys):
    assert benchmark.main(["kitchen-benchmark", *flags]) == 2
    assert "kitchen-benchmark:" in capsys.readouterr().err


def test_help_names_the_flags(capsys):
    assert benchmark.main(["kitchen-benchmark", "--help"]) == 0
    assert "--domain_name" in capsys.readouterr().out


def test_a_gl_library_that_does_not_exist_does_not_matter():
    command = [sys.executable, "-m", "kitchen_suite.benchmark", "--rounds=1", "--steps=1"]
    done = subprocess.run(command, env={**os.environ, "MUJOCO_GL": "nonsense"}, capture_output=True, check=False)
    assert done.returncode == 0


def test_the_summary_takes_medians_of_ratios_round_by_round():
    rates = {BARE: [100.0, 200.0, 400.0], "other": [50.0, 200.0, 800.0]}
    assert benchmark.summarize(rates)["other"] == {
        "ratio": 1.0,
        "least": 0.5,
        "greatest": 2.0,
        "steps_per_second": 200.0,
    }

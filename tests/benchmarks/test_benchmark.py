"""The benchmark measures what it says, on a very small scale."""

import json
import os
import subprocess
import sys

import pytest

from kitchen_suite.benchmarks import report as benchmark_report
from kitchen_suite.benchmarks import speed as benchmark_measure
from kitchen_suite.benchmarks.cases import BARE, Contender
from kitchen_suite.benchmarks.domains import DOMAINS
from kitchen_suite.cli import benchmark

SMALL = ["--rounds=1", "--steps=2", "--environments=2"]


@pytest.mark.parametrize("domain", DOMAINS)
def test_it_prints_a_row_for_every_contender_and_comparison(domain, capsys):
    assert benchmark.main(["kitchen-benchmark", f"--domain_name={domain}", *SMALL]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in DOMAINS[domain].contenders(2):
        (row,) = [line for line in lines if line.startswith(f"{name} ")]
        ratio, least, greatest, a_thread, rate = map(float, row.removeprefix(name).split())
        assert 0 < least == ratio == greatest
        assert a_thread == pytest.approx(ratio / (2 if "2 threads" in name else 1), abs=0.006)
        assert rate > 1
    for name in ("the task's hooks", "suite.load", "Gymnasium adapter"):
        (row,) = [line for line in lines if line.removeprefix(name).strip().replace(".", "").isdigit()]
        assert float(row.removeprefix(name)) > 0
    for name in DOMAINS[domain].comparisons(2):
        (row,) = [line for line in lines if line.startswith(f"{name} ")]
        assert all(float(number) > 0 for number in row.removeprefix(name).split())


def test_json_holds_the_same_and_the_versions(capsys):
    assert benchmark.main(["kitchen-benchmark", *SMALL, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["results"][BARE]["ratio"] == 1.0
    assert {"mujoco", "dm_control", "numpy"} <= result["versions"].keys()
    assert result["command"] == "kitchen-benchmark --rounds=1 --steps=2 --environments=2"


def test_the_scaling_law_has_a_row_for_every_size_and_number_of_threads(capsys):
    flags = ["--domain_name=open_cabinet", "--measure=scaling", "--sizes=1,3", "--control_steps=30"]
    assert benchmark.main(["kitchen-benchmark", *flags, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["results"]
    assert [(row["environments"], row["threads"]) for row in rows] == [(1, 1), (1, 2), (3, 1), (3, 2)]
    assert all(row["steps_per_second"] > 0 for row in rows)
    # An environment more takes some memory, but no second model.
    (memory,) = [row["memory"] for row in rows if row["memory"] is not None]
    assert -5 < memory < 20


def test_a_soak_tells_the_memory_along_the_run(capsys):
    flags = ["--domain_name=open_cabinet", "--measure=soak", "--environments=2", "--control_steps=400"]
    assert benchmark.main(["kitchen-benchmark", *flags, "--json"]) == 0
    results = json.loads(capsys.readouterr().out)["results"]
    assert results["control_steps"][0] == 0
    assert results["control_steps"][-1] == 400
    assert len(results["memory"]) == len(results["control_steps"])
    assert min(results["memory"]) > 10


def test_pages_and_terminals_get_the_same_numbers():
    row = {"builder": "vectorised", "environments": 2, "threads": 1, "steps_per_second": 1234.4, "memory": 0.5}
    results = {"measure": "scaling", "command": "kitchen-benchmark", "versions": {"mujoco": "3"}, "results": [row]}
    for text in (benchmark_report.plain(results), benchmark_report.markdown(results)):
        assert "vectorised, 2" in text
        assert "1234" in text
        assert "0.50" in text
        assert "mujoco 3" in text


@pytest.mark.parametrize(
    "flag", ["--rounds=0", "--rounds=many", "--speed", "fast", "--domain_name=bath", "--sizes=1,x", "--sizes=0"]
)
def test_bad_flags_end_with_code_2(flag, capsys):
    assert benchmark.main(["kitchen-benchmark", flag]) == 2
    assert "kitchen-benchmark:" in capsys.readouterr().err


def test_help_names_the_flags(capsys):
    assert benchmark.main(["kitchen-benchmark", "--help"]) == 0
    assert "--domain_name" in capsys.readouterr().out


def test_a_gl_library_that_does_not_exist_does_not_matter():
    command = [sys.executable, "-m", "kitchen_suite.cli.benchmark", "--domain_name=open_cabinet", *SMALL]
    done = subprocess.run(command, env={**os.environ, "MUJOCO_GL": "nonsense"}, capture_output=True, check=False)
    assert done.returncode == 0


def test_the_summary_takes_medians_of_ratios_round_by_round():
    rates = {BARE: [100.0, 200.0, 400.0], "other": [50.0, 200.0, 800.0]}
    contenders = {BARE: Contender(episode=print), "other": Contender(episode=print, environments=4, threads=2)}
    assert benchmark_measure.summarize(rates, contenders)["other"] == {
        "ratio": 1.0,
        "least": 0.5,
        "greatest": 2.0,
        "ratio_per_thread": 0.5,
        "steps_per_second": 200.0,
    }
    assert benchmark_measure.compare(rates, {"slower": (BARE, "other")}) == {
        "slower": {"ratio": 1.0, "least": 0.5, "greatest": 2.0}
    }

"""Benchmarks measure and report all their cases; each measure is run once, on a very small scale."""

import functools
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.benchmarks import benchmark_job, measurements, rendering
from kitchen_suite.benchmarks.benchmark_job import BenchmarkJob, command_line, find_cases
from kitchen_suite.benchmarks.cases import BARE, Case
from kitchen_suite.commands.commands import benchmark
from kitchen_suite.rendering import quality as light_meshes
from kitchen_suite.settings import BenchmarkSettings

pytestmark = pytest.mark.thorough

SMALL = {"rounds": 1, "max_episode_steps": 2, "num_envs": (2,)}


@pytest.fixture(scope="module", params=[domain.name for domain in suite.DOMAINS.values() if domain.benchmark])
def measured(request):
    """A domain, whose cases are built once, and the results of its speed."""
    domain = find_cases(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(domain, "cases", functools.cache(domain.cases))
        yield domain, BenchmarkJob(BenchmarkSettings(domain_name=request.param, **SMALL)).measure()


@pytest.fixture(scope="module")
def scaling():
    """The command that measures the scaling of open_cabinet, run where no GL library can be loaded."""
    flags = ["--domain_name=open_cabinet", "--measure=scaling", "--num_envs=1,3", "--num_steps=30", "--json"]
    command = [sys.executable, "-m", "kitchen_suite", "benchmark", *flags]
    return subprocess.run(command, env={**os.environ, "MUJOCO_GL": "nonsense"}, capture_output=True, text=True)


def test_every_case_has_a_row(measured):
    domain, results = measured
    lines = benchmark_job.plain(results).splitlines()
    for name in domain.cases(2):
        (row,) = [line for line in lines if line.startswith(f"{name} ")]
        ratio, minimum, maximum, per_thread, rate = map(float, row.removeprefix(name).split())
        assert 0 < minimum == ratio == maximum
        assert per_thread == pytest.approx(ratio / (2 if "2 threads" in name else 1), abs=0.006)
        assert rate > 1


def test_every_named_ratio_has_a_row(measured):
    domain, results = measured
    lines = benchmark_job.plain(results).splitlines()
    for name in domain.ratios(2):
        (row,) = [line for line in lines if line.startswith(f"{name} ")]
        numbers = [float(number) for number in row.removeprefix(name).split()]
        assert len(numbers) == 3
        assert min(numbers) > 0


def test_the_overhead_has_a_row_for_each_layer(measured):
    _, results = measured
    lines = benchmark_job.plain(results).splitlines()
    for name in ("the task's hooks", "suite.load", "Gymnasium adapter"):
        (row,) = [line for line in lines if line.removeprefix(name).strip().replace(".", "").isdigit()]
        assert float(row.removeprefix(name)) > 0


def test_the_ratio_of_bare_mujoco_to_itself_is_one(measured):
    _, results = measured
    assert results["results"][BARE]["ratio"] == 1.0


def test_results_name_the_versions_and_the_command(measured):
    _, results = measured
    assert {"python", "mujoco", "dm-control", "numpy"} <= results["versions"].keys()
    assert results["command"].startswith("kitchen-benchmark ")
    assert results["command"].endswith("--rounds=1 --max_episode_steps=2 --num_envs=2")


def test_the_command_line_leaves_out_defaults_and_json():
    settings = BenchmarkSettings(domain_name="open_cabinet", num_envs=(1, 8), json=True)
    assert command_line(settings).split() == ["kitchen-benchmark", "--domain_name=open_cabinet", "--num_envs=1,8"]


def test_a_gl_library_that_does_not_exist_does_not_matter(scaling):
    assert (scaling.returncode, scaling.stderr) == (0, "")


def test_scaling_has_a_row_for_every_number_of_environments_and_threads(scaling):
    rows = json.loads(scaling.stdout)["results"]
    assert [(row["num_envs"], row["num_threads"]) for row in rows] == [(1, 1), (1, 2), (3, 1), (3, 2)]
    assert all(row["steps_per_second"] > 0 for row in rows)
    # A further environment takes some memory, but no second model.
    (memory,) = [row["memory"] for row in rows if row["memory"] is not None]
    assert -5 < memory < 20


def test_a_soak_samples_the_memory_along_the_run(capsys):
    flags = ["--domain_name=open_cabinet", "--measure=soak", "--num_envs=2", "--num_steps=400"]
    assert benchmark.main([*flags, "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert output["command"].split()[0] == "kitchen-benchmark"
    assert sorted(output["command"].split()[1:]) == sorted(flags)
    results = output["results"]
    assert results["num_steps"][0] == 0
    assert results["num_steps"][-1] == 400
    assert len(results["memory"]) == len(results["num_steps"])
    assert min(results["memory"]) > 10


def test_pages_and_terminals_get_the_same_numbers(capsys, monkeypatch):
    row = {"vector_env": "vectorised", "num_envs": 2, "num_threads": 1, "steps_per_second": 1234.4, "memory": 0.5}
    results = {"measure": "scaling", "command": "kitchen-benchmark", "versions": {"mujoco": "3"}, "results": [row]}
    monkeypatch.setattr(BenchmarkJob, "measure", lambda job: results)
    assert benchmark.main([]) == 0
    printed = capsys.readouterr().out
    assert printed == benchmark_job.plain(results) + "\n"
    for text in (printed, benchmark_job.markdown(results)):
        assert "vectorised, 2" in text
        assert "1234" in text
        assert "0.50" in text
        assert "mujoco 3" in text


@pytest.mark.parametrize(
    "flag",
    [
        "--rounds=0",
        "--rounds=many",
        "--speed",
        "fast",
        "--domain_name=bath",
        "--measure=comfort",
        "--num_envs=1,8",
        "--num_envs=1,x",
        "--num_envs=0",
        "--num_steps=0",
    ],
)
def test_bad_flags_end_with_code_2(flag, capsys):
    assert benchmark.main([flag]) == 2
    assert "kitchen-benchmark:" in capsys.readouterr().err


def test_a_misspelt_flag_gets_the_one_that_is_meant(capsys):
    for flag, meant in {"steps": "num_steps", "num_env": "num_envs", "round": "rounds"}.items():
        assert benchmark.main([f"--{flag}=1"]) == 2
        assert f"there is no flag --{flag} (did you mean --{meant}?)" in capsys.readouterr().err


def test_help_names_the_flags(capsys):
    assert benchmark.main(["--help"]) == 0
    assert "--domain_name" in capsys.readouterr().out


def test_the_summary_takes_medians_of_ratios_round_by_round():
    rates = {BARE: [100.0, 200.0, 400.0], "other": [50.0, 200.0, 800.0]}
    cases = {BARE: Case(episode=print), "other": Case(episode=print, num_envs=4, num_threads=2)}
    assert measurements.summarize(rates, cases)["other"] == {
        "ratio": 1.0,
        "min": 0.5,
        "max": 2.0,
        "ratio_per_thread": 0.5,
        "steps_per_second": 200.0,
    }
    assert measurements.named_ratios(rates, {"slower": (BARE, "other")}) == {
        "slower": {"ratio": 1.0, "min": 0.5, "max": 2.0}
    }


@pytest.fixture
def small_frames(monkeypatch, tmp_path):
    """Benchmarks of rendering that take one tiny frame of each kind."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(rendering, "SIZES", (16, 24))
    monkeypatch.setattr(rendering, "SECONDS", 0.0)


RENDERERS = ("high", "fast, without light meshes", "fast")


@pytest.mark.rendering
@pytest.mark.parametrize(
    ("domain", "baseline"),
    # Frames of the original take half a second each.
    [pytest.param("kitchen", ("Gymnasium-Robotics",), marks=pytest.mark.slow), ("open_cabinet", ())],
)
def test_rendering_has_a_row_for_every_renderer_size_and_content(domain, baseline, small_frames, capsys):
    flags = [f"--domain_name={domain}", "--measure=rendering", "--rounds=1"]
    assert benchmark.main([*flags, "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert [each["size"] for each in results["results"]] == [16, 24]
    for each in results["results"]:
        assert (*each["renderers"],) == (*baseline, *RENDERERS)
        for row in each["renderers"].values():
            assert row["ratio"] > 0
            assert min(row["times"].values()) > 0
        assert each["renderers"][[*baseline, "high"][0]]["ratio"] == 1.0
        *full, light = (row["num_faces"] for row in each["renderers"].values())
        assert len(set(full)) == 1
        assert min(full) > 130_000 > 25_000 > light
    first, second = (each["renderers"]["fast"]["contents"] for each in results["results"])
    assert {*first} == {*rendering.CONTENTS}
    assert second == {}
    lines = benchmark_job.plain(results).splitlines()
    for name in (*baseline, *RENDERERS):
        for size in (16, 24):
            assert len([line for line in lines if line.startswith(f"{name}, {size} x {size} ")]) == 2
    for content in rendering.CONTENTS:
        (row,) = [line for line in lines if line.startswith(f"{content} ")]
        assert len(row.removeprefix(content).split()) == len(baseline) + len(RENDERERS)


@pytest.mark.slow
@pytest.mark.rendering
def test_frames_are_measured_without_what_they_consist_of(small_frames):
    timers = {name: rendering.FrameTimer(each) for name, each in find_cases("kitchen").renderers(96).items()}
    for name, timer in timers.items():
        timer.frame()
        picture = timer.picture()
        for content in rendering.CONTENTS:
            with timer.leaving_out(content):
                without = timer.picture()
            # The floor reflects, but is not in the picture; `fast` has no shadows, sky or reflections.
            absent = ("reflections", *([] if name in ("Gymnasium-Robotics", "high") else ["shadows", "sky and haze"]))
            assert (without != picture).any() or content in absent, (name, content)
        timer.frame()
        np.testing.assert_array_equal(timer.picture(), picture)
    for timer in timers.values():
        timer.close()


@pytest.mark.slow
@pytest.mark.rendering
def test_rendering_without_the_extra_leaves_light_meshes_out(small_frames, monkeypatch):
    monkeypatch.setattr(light_meshes, "missing_packages", lambda: ["no-such-package"])
    (each, _) = rendering.measure(find_cases("open_cabinet").renderers, rounds=1)
    assert (*each["renderers"],) == RENDERERS[:2]


def test_rendering_without_a_gl_library_ends_with_one_line(monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    assert benchmark.main(["--measure=rendering"]) == 2
    assert "rendering is disabled by MUJOCO_GL=disable" in capsys.readouterr().err

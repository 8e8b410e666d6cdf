"""Benchmarks measure and report all their cases; each measure is run once, on a very small scale."""

import functools
import json

import numpy as np
import pytest
from docs_scripts import load_script

pytestmark = pytest.mark.full

RENDERERS = ("high", "fast, without light meshes", "fast")


@pytest.fixture(scope="module")
def benchmarks():
    return load_script("experiments/benchmarks")


@pytest.fixture(scope="module")
def tables():
    return load_script("experiments/benchmark_tables")


@pytest.fixture(scope="module", params=["kitchen", "open_cabinet"])
def measured(request, benchmarks):
    """A domain, whose cases are built once, and the results of its speed."""
    domain = benchmarks.DOMAINS[request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(domain, "cases", functools.cache(domain.cases))
        results = benchmarks.measure_speed(domain, num_envs=2, rounds=1, steps=2)
        yield domain, {"measure": "speed", "command": "benchmarks.py", "versions": {"mujoco": "3"}, **results}


def rows_of(text, names):
    """Returns the numbers of the one row of each name in a text with tables."""
    rows = {}
    for name in names:
        (row,) = [line for line in text.splitlines() if line.startswith(f"{name} ")]
        rows[name] = [float(number) for number in row.removeprefix(name).split()]
    return rows


def test_every_case_has_a_row(measured, tables):
    domain, results = measured
    for name, row in rows_of(tables.plain(results), domain.cases(2)).items():
        ratio, minimum, maximum, per_thread, rate = row
        assert 0 < minimum == ratio == maximum
        assert per_thread == pytest.approx(ratio / (2 if "2 threads" in name else 1), abs=0.006)
        assert rate > 1


def test_every_named_ratio_has_a_row(measured, tables):
    domain, results = measured
    for row in rows_of(tables.plain(results), domain.ratios(2)).values():
        assert len(row) == 3
        assert min(row) > 0


def test_the_overhead_beyond_physics_is_measured_of_each_layer(measured):
    _, results = measured
    overhead = results["overhead"]
    assert [*overhead] == ["the task's hooks", "suite.load", "Gymnasium adapter"]
    # How large it is says the benchmark: of so few steps, a busy machine decides.
    assert np.isfinite([*overhead.values()]).all()


def test_the_summary_takes_medians_of_ratios_round_by_round(benchmarks):
    rates = {"bare": [100.0, 200.0, 400.0], "other": [50.0, 200.0, 800.0]}
    cases = {
        "bare": benchmarks.Case(episode=print),
        "other": benchmarks.Case(episode=print, num_envs=4, num_threads=2),
    }
    assert benchmarks.summarize(rates, cases)["other"] == {
        "ratio": 1.0,
        "min": 0.5,
        "max": 2.0,
        "ratio_per_thread": 0.5,
        "steps_per_second": 200.0,
    }
    assert benchmarks.named_ratios(rates, {"slower": ("bare", "other")}) == {
        "slower": {"ratio": 1.0, "min": 0.5, "max": 2.0}
    }


@pytest.fixture
def rendering(monkeypatch, tmp_path):
    """The script, which takes one tiny frame of each kind."""
    module = load_script("experiments/rendering")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(module, "SIZES", (16, 24))
    monkeypatch.setattr(module, "SECONDS", 0.0)
    return module


@pytest.mark.rendering
@pytest.mark.parametrize(
    ("domain", "baseline"),
    # Frames of the original take half a second each.
    [pytest.param("kitchen", ("Gymnasium-Robotics",), marks=pytest.mark.nightly), ("open_cabinet", ())],
)
def test_rendering_has_a_row_for_every_renderer_size_and_content(domain, baseline, rendering, tables, capsys):
    rendering.main([f"--domain_name={domain}", "--rounds=1", "--json"])
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
    lines = tables.plain(results).splitlines()
    for name in (*baseline, *RENDERERS):
        for size in (16, 24):
            assert len([line for line in lines if line.startswith(f"{name}, {size} x {size} ")]) == 2
    for content in rendering.CONTENTS:
        (row,) = [line for line in lines if line.startswith(f"{content} ")]
        assert len(row.removeprefix(content).split()) == len(baseline) + len(RENDERERS)


@pytest.mark.nightly
@pytest.mark.rendering
def test_frames_are_measured_without_what_they_consist_of(rendering):
    renderers = rendering.build_renderers(rendering.DOMAINS["kitchen"], 96)
    timers = {name: rendering.FrameTimer(each) for name, each in renderers.items()}
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


@pytest.mark.nightly
@pytest.mark.rendering
def test_rendering_without_the_extra_leaves_light_meshes_out(rendering, monkeypatch):
    monkeypatch.setattr(rendering.quality, "missing_packages", lambda: ["no-such-package"])
    (each, _) = rendering.measure(rendering.DOMAINS["open_cabinet"], rounds=1)
    assert (*each["renderers"],) == RENDERERS[:2]

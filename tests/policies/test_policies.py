"""The policies of `kitchen-rollout`, on any action space; and its report, on any results."""

import sys
import types

import dm_env
import numpy as np
import pytest
from dm_env import specs

from kitchen_suite import policies, suite
from kitchen_suite.rollouts.episode import EpisodeStats
from kitchen_suite.rollouts.report import Report

START = dm_env.restart(observation={})


def build(name, minimum, maximum, size=8, seed=0):
    spec = specs.BoundedArray((size,), np.float64, minimum, maximum)
    return policies.find(name)(types.SimpleNamespace(action_spec=lambda: spec), np.random.default_rng(seed))


def draw(policy, count=2000):
    return np.stack([policy(START) for _ in range(count)])


def test_random_is_uniform_within_the_bounds():
    actions = draw(build("random", [-1, 0], [1, 0.04], size=2))
    assert (actions >= [-1, 0]).all()
    assert (actions <= [1, 0.04]).all()
    # Five standard errors of the mean of 2,000 numbers uniform in [0, 1]: 5 * 0.2887 / sqrt(2000) = 0.032.
    np.testing.assert_allclose((actions.mean(axis=0) - [-1, 0]) / [2, 0.04], 0.5, atol=0.032)


def test_random_is_standard_normal_where_actions_are_unbounded():
    actions = draw(build("random", -np.inf, np.inf))
    # 16,000 numbers; five standard errors of their mean are 0.040, of their deviation 0.028.
    assert abs(actions.mean()) < 0.04
    assert abs(actions.std() - 1) < 0.028
    assert np.abs(actions).max() > 3


def test_random_differs_by_seed_only():
    one, same, other = (draw(build("random", -1, 1, seed=seed), 3) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("bound", [1.0, np.inf])
def test_zero_is_zero(bound):
    action = build("zero", -bound, bound)(START)
    np.testing.assert_array_equal(action, np.zeros(8))


def test_actions_become_float64_unrounded_and_are_copies(monkeypatch):
    buffer = np.full(8, 0.1, np.float32)
    module = types.SimpleNamespace(act=lambda timestep: buffer)
    monkeypatch.setitem(sys.modules, "module_of_a_user", module)
    action = build("module_of_a_user:act", -1, 1)(START)
    assert action.dtype == np.float64
    buffer[:] = 0
    np.testing.assert_array_equal(action, np.float64(np.float32(0.1)))


def test_importing_a_module_that_exits_does_not_exit(tmp_path, monkeypatch):
    tmp_path.joinpath("script_of_a_user.py").write_text("raise SystemExit(0)")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match="'script_of_a_user:act' cannot be imported: SystemExit"):
        policies.find("script_of_a_user:act")


def outcome(seed=0, **results):
    return EpisodeStats(seed=seed, steps=10, total_reward=-1234.5678, results=results, seconds=0.5)


def test_any_results_are_reported():
    report = Report(last_seed=10)
    text = report.add(outcome(9, opened_at={"drawer": 3}, success=True, drawer_opening=0.31234567))
    assert text.splitlines() == [
        "episode  seed    return  steps  seconds  success  drawer opening  opened at (at control step)",
        "      0     9   -1234.6     10     0.50      yes         0.31235  drawer (3)",
    ]
    assert report.add(outcome(10, opened_at={}, success=False, drawer_opening=-1.0)).splitlines() == [
        "      1    10   -1234.6     10     0.50       no              -1  none",
    ]
    assert report.count == 2
    assert report.summary().splitlines() == [
        "episodes             2",
        "mean return          -1234.6",
        "mean opened at       0.5",
        "success rate         50% (1 of 2)",
        "mean drawer opening  -0.34383",
        "steps per second     20",
    ]


def test_many_events_take_several_lines_of_a_hundred_columns():
    text = Report(last_seed=0).add(outcome(tasks_completed=dict.fromkeys([f"task number {i}" for i in range(7)], 200)))
    heading, *lines = text.splitlines()
    column = heading.index("tasks completed")
    assert len(lines) > 1
    assert max(map(len, lines)) <= 100
    assert all(line[:column].isspace() and line[column:].startswith("task number") for line in lines[1:])
    told = " ".join(line[column:] for line in lines)
    assert told == ", ".join(f"task number {i} (200)" for i in range(7))


@pytest.mark.parametrize("seed", [10**24, 10**90])
def test_a_long_seed_leaves_the_heading_in_one_line(seed):
    heading, *lines = Report(last_seed=seed).add(outcome(seed, tasks_completed={"kettle": 1})).splitlines()
    assert heading.endswith("tasks completed (at control step)")
    assert " ".join(line.strip() for line in lines).endswith("kettle (1)")
    assert lines[0].index("kettle") == heading.index("tasks")

    assert Report(last_seed=0).add(outcome()).splitlines() == [
        "episode  seed    return  steps  seconds",
        "      0     0   -1234.6     10     0.50",
    ]


def test_a_task_without_results_is_reported_too():
    assert Report(last_seed=0).add(outcome()).splitlines() == [
        "episode  seed    return  steps  seconds",
        "      0     0   -1234.6     10     0.50",
    ]


@pytest.fixture(scope="module")
def kettle():
    return suite.load("kitchen", "kettle", {"visuals": False})


def test_the_expert_takes_options_by_name(kettle):
    policies.find("expert(speed=0.5, action_noise=0.1, jitter=0.01, threshold=0.15)")(kettle, np.random.default_rng(0))


@pytest.mark.parametrize(
    "name",
    ["expert(0.5)", "expert(speed=)", "expert(speed=fast)", "expert(**{})", "import os; expert()", "zero(speed=1)"],
)
def test_options_that_are_none_are_refused(name):
    with pytest.raises(ValueError, match="options"):
        policies.find(name)


@pytest.mark.parametrize("name", ["expert(speed=2)", "expert(haste=1)", "expert(jitter='much')"])
def test_options_that_the_expert_does_not_take_are_the_policys_fault(name, kettle):
    with pytest.raises(policies.PolicyError, match="cannot be built"):
        policies.find(name)(kettle, np.random.default_rng(0))

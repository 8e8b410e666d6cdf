"""The report of `kitchen-rollout`, on any metrics."""

import dataclasses

import pytest

from kitchen_suite.episodes.episode import Summary
from kitchen_suite.episodes.report import Report


def stats(seed=0, **metrics):
    return Summary(seed=seed, steps=10, total_reward=-1234.5678, metrics=metrics, seconds=0.5)


def test_any_metrics_are_reported():
    report = Report(last_seed=10)
    text = report.add(stats(9, opened_at={"drawer": 3}, success=True, drawer_opening=0.31234567))
    assert text.splitlines() == [
        "episode  seed    return  steps  seconds  success  drawer opening  opened at (at control step)",
        "      0     9   -1234.6     10     0.50      yes         0.31235  drawer (3)",
    ]
    assert report.add(stats(10, opened_at={}, success=False, drawer_opening=-1.0)).splitlines() == [
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
    text = Report(last_seed=0).add(stats(tasks_completed=dict.fromkeys([f"task number {i}" for i in range(7)], 200)))
    heading, *lines = text.splitlines()
    column = heading.index("tasks completed")
    assert len(lines) > 1
    assert max(map(len, lines)) <= 100
    assert all(line[:column].isspace() and line[column:].startswith("task number") for line in lines[1:])
    reported = " ".join(line[column:] for line in lines)
    assert reported == ", ".join(f"task number {i} (200)" for i in range(7))


@pytest.mark.parametrize("seed", [10**24, 10**90])
def test_a_long_seed_leaves_the_heading_in_one_line(seed):
    heading, *lines = Report(last_seed=seed).add(stats(seed, tasks_completed={"kettle": 1})).splitlines()
    assert heading.endswith("tasks completed (at control step)")
    assert " ".join(line.strip() for line in lines).endswith("kettle (1)")
    assert lines[0].index("kettle") == heading.index("tasks")


def test_a_task_without_metrics_is_reported():
    assert Report(last_seed=0).add(stats()).splitlines() == [
        "episode  seed    return  steps  seconds",
        "      0     0   -1234.6     10     0.50",
    ]


def test_episodes_that_took_no_time_have_no_speed():
    """Those of kitchen-convert."""
    report = Report(last_seed=1)
    report.add(dataclasses.replace(stats(), seconds=0.0))
    assert "steps per second" not in report.summary()
    report.add(stats(1))
    assert report.summary().endswith("steps per second  20")

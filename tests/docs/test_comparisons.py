"""Simulated comparisons: what the page says of coverage and false alarms, in fewer pairs."""

import math

import numpy as np
import pytest
from docs_scripts import load_script

import kitchen_suite


@pytest.fixture
def comparisons():
    return load_script("experiments/comparisons")


def within(share, expected, count):
    """Whether a share is the expected one within five standard errors."""
    return abs(share - expected) < 5 * math.sqrt(expected * (1.0 - expected) / count)


@pytest.mark.parametrize("case", ["alike", "spread", "wide"])
def test_intervals_of_methods_contain_the_truth(comparisons, case):
    row = comparisons.simulate_methods({"case": case, "seeds": 3}, pairs=200)
    assert within(row["coverage"], 0.955, 200)
    assert row["coverage_resampled"] < 0.95 or case == "alike"


def test_true_rates_are_those_that_are_named(comparisons):
    drawn = comparisons.draw_methods("wide", 10, 100, np.random.default_rng(0))
    rates = np.mean([[each.mean() for each in pair] for pair in drawn], axis=0)
    # A thousand training seeds, whose rates deviate by 15 %.
    assert rates == pytest.approx([0.8, 0.7], abs=0.025)


@pytest.mark.full
def test_kitchens_raise_no_more_false_alarms_than_they_should(comparisons):
    row = comparisons.simulate_kitchens({"correlation": 0.4}, pairs=200)
    assert row["alarms"] < 0.05 + 5 * math.sqrt(0.05 * 0.95 / 200)
    # By episodes a sixth.
    assert row["alarms_episodes"] > 0.09
    assert row["alarms"] < row["alarms_episodes"]


def test_kitchens_have_the_correlation_that_is_named(comparisons):
    generator = np.random.default_rng(1)
    counts = np.array([comparisons.draw_kitchens(0.4, generator).reshape(-1, 4).sum(axis=1) for _ in range(50)]).ravel()
    assert counts.mean() / 4 == pytest.approx(0.8, abs=0.03)
    # The variance of four episodes, of which each pair has this correlation.
    assert counts.var() == pytest.approx(4 * 0.8 * 0.2 * (1 + 3 * 0.4), rel=0.1)


def test_the_bars_hold_in_what_was_measured(comparisons):
    methods = comparisons.RESULTS / "comparison_methods.json"
    for row in load_script("experiments/experiment").read_rows(methods):
        if row["case"] != "some collapse":
            assert (row["pairs"], 0.93 <= row["coverage"] <= 0.97) == (2_000, True)
    for row in load_script("experiments/experiment").read_rows(comparisons.RESULTS / "comparison_kitchens.json"):
        assert (row["pairs"], row["alarms"] <= 0.06) == (2_000, True)


@pytest.mark.parametrize(("seeds", "shown"), [((1, 2, 3), (0.04, "a")), ((1, 2, 3, 4, 5), (0.07, None))])
def test_the_example_shows_a_difference_by_three_seeds_and_none_by_five(comparisons, seeds, shown):
    """As the page says of its example."""
    folder = comparisons.RESULTS / "comparison"
    a, b = ([folder / f"{name}_{seed}.json" for seed in seeds] for name in ("gain", "dense"))
    comparison = kitchen_suite.compare_methods(a, b)
    assert (pytest.approx(comparison.p_value, abs=0.005), comparison.better) == shown

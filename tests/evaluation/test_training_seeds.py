"""Statistics of methods of several training seeds: limits that SciPy has, symmetry, coverage."""

import numpy as np
import pytest
from scipy import stats

from kitchen_suite.evaluation.training_seeds import method_difference, method_mean


def test_without_differences_between_episodes_it_is_welchs_test_of_seeds():
    generator = np.random.default_rng(0)
    first, second = generator.random(3), generator.random(5)
    found = method_difference(np.repeat(first[:, None], 50, axis=1), np.repeat(second[:, None], 50, axis=1))
    expected = stats.ttest_ind(first, second, equal_var=False)
    assert found.p_value == pytest.approx(expected.pvalue)
    assert found.interval == pytest.approx(tuple(expected.confidence_interval()))
    one = method_mean(np.repeat(first[:, None], 50, axis=1))
    assert one.interval == pytest.approx(tuple(stats.ttest_1samp(first, 0.0).confidence_interval()))


def test_without_differences_between_seeds_it_is_the_paired_test_of_episodes():
    generator = np.random.default_rng(1)
    first, second = generator.normal(size=(2, 40))
    found = method_difference(np.tile(first, (3, 1)), np.tile(second, (4, 1)))
    expected = stats.ttest_rel(first, second)
    assert found.value == pytest.approx(first.mean() - second.mean())
    assert found.p_value == pytest.approx(expected.pvalue)
    assert found.interval == pytest.approx(tuple(expected.confidence_interval()))


def test_swapping_the_methods_mirrors_everything():
    first, second = np.random.default_rng(2).random((2, 4, 30))
    one, other = method_difference(first, second), method_difference(second, first)
    assert one.value == -other.value
    assert one.interval == pytest.approx((-other.interval[1], -other.interval[0]))
    assert one.p_value == pytest.approx(other.p_value)


@pytest.mark.parametrize("power", [-900, 900])
def test_huge_and_tiny_values_have_the_interval_of_their_multiples(power):
    first, second = np.random.default_rng(3).normal(size=(2, 4, 30))
    expected = method_difference(first, second)
    found = method_difference(np.ldexp(first, power), np.ldexp(second, power))
    assert found.interval == pytest.approx(tuple(np.ldexp(expected.interval, power)))
    assert found.p_value == pytest.approx(expected.p_value)


def test_methods_that_never_fail_have_the_limits_of_their_episodes():
    ones = np.ones((3, 200))
    same = method_difference(ones, ones, greatest=1.0)
    # With 200 of 200 alike, others have a probability of at most 1 - 0.025^(1/200), of 1.83 %.
    assert (same.value, same.p_value) == (0.0, 1.0)
    assert same.interval == pytest.approx((-0.0183, 0.0183), abs=1e-4)
    assert method_mean(ones, low=0.0, high=1.0).interval == pytest.approx((0.9817, 1.0), abs=1e-4)
    assert method_difference(ones, ones).interval is None
    better = method_difference(ones, 0.0 * ones, greatest=1.0)
    assert better.p_value < 1e-30
    assert better.interval == pytest.approx((1.0 - 2 * 0.0183, 1.0), abs=1e-3)
    few = method_difference(ones[:, :4], 0.0 * ones[:, :4], greatest=1.0)
    assert few.p_value == 0.125
    assert few.interval[0] < 0.0


def test_p_and_the_interval_agree():
    generator = np.random.default_rng(4)
    for _ in range(200):
        first, second = generator.random((2, 3, 20)) < generator.uniform(0.3, 0.9, (2, 3, 1))
        found = method_difference(first.astype(float), second.astype(float))
        assert (found.p_value < 0.05) == (not found.interval[0] <= 0.0 <= found.interval[1])


def test_intervals_stop_at_what_is_possible():
    values = np.ones((3, 20))
    values[0, :8] = 0.0
    low, high = method_mean(values, low=0.0, high=1.0).interval
    assert 0.0 < low < values.mean() < high == 1.0


def test_seeds_of_the_same_rate_by_chance_prove_nothing():
    """Each seed fails in one other episode: their means are equal, and single episodes have noise all the same."""
    first, second = np.ones((2, 3, 200))
    first[[0, 1, 2], [3, 5, 8]] = 0.0
    found = method_difference(first, second, greatest=1.0)
    assert found.value == pytest.approx(-0.005)
    assert 0.05 < found.p_value < 0.15
    assert found.interval == pytest.approx((-0.0107, 0.0007), abs=2e-4)

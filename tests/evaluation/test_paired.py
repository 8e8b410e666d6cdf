"""Statistics of paired episodes: published values of textbook tables, limits, symmetry, and Holm's method."""

import dataclasses
import math
import types

import numpy as np
import pytest
from scipy import stats

from kitchen_suite.evaluation import paired
from kitchen_suite.evaluation.paired import (
    PairedVerdicts,
    cluster_difference,
    cluster_totals,
    holm,
    mean_difference,
    permutation_p_value,
    score_interval,
)

# Wins, losses and pairs; the interval and its level; the exact p-value of McNemar's test, None where none is published.
# Each was printed by the source named, to the digits given here.
PUBLISHED = {
    # Complete response before and after consolidation therapy (Cavo et al. 2012), in M. Fagerland, S. Lydersen and P.
    # Laake, Statistical Analysis of Contingency Tables (2017), chapter 8: 59, 6, 16, 80. From the tests of the authors'
    # R package contingencytables, Tango_asymptotic_score_CI_paired_2x2 and McNemar_exact_cond_test_paired_2x2.
    "Cavo": (6, 16, 161, 0.95, (-0.1240, -0.0054), 0.052479),
    # Airway hyper-responsiveness before and after transplantation (Bentur et al. 2009), in M. Fagerland, S. Lydersen
    # and P. Laake, Statistics in Medicine 33 (2014) 2850-2875: 1, 1, 7, 12. The p-value is 2 (1 + 8) / 2^8.
    "Bentur": (1, 7, 21, 0.95, (-0.517, -0.026), 0.0703125),
    # PropCIs::scoreci.mp(25, 28, 618, 0.9) in R, whose difference is the second count less the first.
    "PropCIs": (28, 25, 618, 0.90, (-0.0148, 0.0247), None),
}

# Approval of a president in two surveys (A. Agresti, Categorical Data Analysis, 1990, page 350): 794, 150, 86, 570. By
# statsmodels 0.15, mcnemar([[794, 150], [86, 570]], exact=True).
APPROVAL = (150, 86, 1600, 3.7159e-05)


@pytest.mark.parametrize("name", PUBLISHED)
def test_intervals_and_p_values_are_those_published(name):
    wins, losses, count, confidence, interval, p_value = PUBLISHED[name]
    decimals = 3 if name == "Bentur" else 4
    found = score_interval(wins, losses, count, confidence)
    assert [round(bound, decimals) for bound in found] == [*interval]
    if p_value is not None:
        verdicts = PairedVerdicts(wins=wins, losses=losses, ties=count - wins - losses)
        assert verdicts.p_value == pytest.approx(p_value, rel=1e-4)


def test_the_p_value_of_approval_is_that_of_statsmodels():
    wins, losses, count, p_value = APPROVAL
    verdicts = PairedVerdicts(wins=wins, losses=losses, ties=count - wins - losses)
    assert verdicts.p_value == pytest.approx(p_value, rel=1e-4)


def test_the_interval_excludes_zero_where_the_asymptotic_test_rejects():
    quantile = 1.959964
    for wins in range(30):
        for losses in range(30):
            low, high = score_interval(wins, losses, 60)
            statistic = abs(wins - losses) / max(1.0, wins + losses) ** 0.5
            if abs(statistic - quantile) > 1e-6:
                assert (low > 0.0 or high < 0.0) == (statistic > quantile)


@pytest.mark.parametrize("count", [1, 2, 10, 200, 50_000])
def test_intervals_are_possible_and_never_certain(count):
    for wins, losses in ((0, 0), (count, 0), (0, count), (count // 2, count - count // 2), (1, 0), (0, 1)):
        low, high = score_interval(wins, losses, count)
        assert -1.0 <= low < high <= 1.0
        assert low <= (wins - losses) / count <= high
    assert score_interval(count, 0, count)[1] == 1.0


# Levels with their quantiles of the normal distribution.
@pytest.mark.parametrize(
    ("count", "confidence", "quantile"), [(50, 0.95, 1.959964), (1, 0.95, 1.959964), (1, 0.5, 0.674490)]
)
def test_an_interval_without_differences_is_that_of_the_score_equation(count, confidence, quantile):
    bound = quantile**2 / (count + quantile**2)
    assert score_interval(0, 0, count, confidence) == pytest.approx((-bound, bound), rel=1e-5)


def test_swapping_the_policies_mirrors_everything():
    generator = np.random.default_rng(0)
    first, second = generator.random((2, 40)) < [[0.9], [0.6]]
    one, other = PairedVerdicts.of(first, second), PairedVerdicts.of(second, first)
    assert (one.wins, one.losses, one.ties) == (other.losses, other.wins, other.ties)
    assert one.interval == (-other.interval[1], -other.interval[0])
    assert (one.p_value, one.difference) == (other.p_value, -other.difference)
    tasks = generator.integers(-3, 4, 40)
    middle, (low, high) = mean_difference(tasks, greatest=4)
    assert mean_difference(-tasks, greatest=4) == (-middle, (pytest.approx(-high), pytest.approx(-low)))


def test_without_wins_and_losses_no_difference_is_found():
    verdicts = PairedVerdicts.of([True, False], [True, False])
    assert (verdicts.wins, verdicts.losses, verdicts.ties, verdicts.p_value) == (0, 0, 2, 1.0)


def test_verdicts_are_counted_by_which_policy_succeeded():
    first = [True] * 5 + [False] * 5
    second = [True, True, False, False, False, True, False, False, False, False]
    with np.errstate(all="raise"):
        verdicts = PairedVerdicts.of(first, second)
    assert (verdicts.wins, verdicts.losses, verdicts.ties, verdicts.count) == (3, 1, 6, 10)
    assert verdicts.difference == pytest.approx(0.2)
    assert verdicts.interval == score_interval(3, 1, 10, 0.95)
    # Of four coins, three or more alike: 2 (1 + 4) / 2^4.
    assert verdicts.p_value == pytest.approx(0.625)
    with pytest.raises(dataclasses.FrozenInstanceError):
        verdicts.wins = 4
    with pytest.raises(TypeError, match="positional"):
        PairedVerdicts(3, 1, 6)


@pytest.mark.parametrize(("first", "second"), [([], []), ([True, False], [True]), ([True], [True, False])])
def test_verdicts_that_are_no_pairs_are_refused(first, second):
    with pytest.raises(ValueError, match="no pairs"):
        PairedVerdicts.of(first, second)


def test_the_bootstrap_is_that_of_the_mean_and_the_same_every_time():
    values = np.random.default_rng(1).integers(-2, 4, 400)
    middle, (low, high) = mean_difference(values, greatest=4)
    assert middle == values.mean()
    # At 400 values the normal interval agrees within a tenth of its width.
    half = 1.96 * values.std(ddof=1) / 20
    assert (low, high) == pytest.approx((middle - half, middle + half), abs=0.2 * half)
    assert mean_difference(values, greatest=4) == (middle, (low, high))


@pytest.mark.parametrize(("size", "batch", "unit"), [(2, 5_000_000, 2), (3, 3_333_333, 4)])
def test_the_bootstrap_has_fixed_random_numbers_and_little_memory(size, batch, unit, monkeypatch):
    """It holds at most ten million numbers at once, but of at least one sample, which is below 1 in its unit."""
    given = {}

    def bootstrap(data, statistic, **others):
        given.update(others, data=data, mean=statistic(np.array([1.0, 3.0])))
        return types.SimpleNamespace(confidence_interval=types.SimpleNamespace(low=-2, high=5))

    monkeypatch.setattr(paired.stats, "bootstrap", bootstrap)
    assert mean_difference(np.arange(size)) == ((size - 1) / 2, (-2.0 * unit, 5.0 * unit))
    assert (given["confidence_level"], given["n_resamples"], given["batch"]) == (0.95, 9999, batch)
    assert given["random_state"].random() == np.random.default_rng(0).random()
    assert given["mean"] == 2.0
    np.testing.assert_array_equal(given["data"], [np.arange(size) / unit])
    monkeypatch.setattr(paired, "_BATCH_NUMBERS", size - 1)
    mean_difference(np.arange(size))
    assert given["batch"] == 1


def test_differences_of_at_most_one_are_differences():
    # The bootstrap of a share agrees roughly with the normal interval, 0.5 -+ 1.96 x 0.5 / sqrt(100).
    middle, interval = mean_difference([0.0, 1.0] * 50)
    assert (middle, interval) == (0.5, pytest.approx((0.402, 0.598), abs=0.02))
    middle, interval = mean_difference([0.0, math.ldexp(1.0, -10)] * 50)
    assert interval == pytest.approx((0.402 / 1024, 0.598 / 1024), abs=0.02 / 1024)


def test_equal_differences_leave_the_others_that_the_exact_limit_allows():
    # With 200 of 200 alike, others have a probability of at most 1 - 0.025^(1/200), of 1.83 %.
    middle, (low, high) = mean_difference(np.zeros(200), greatest=4)
    assert (middle, low, high) == (0.0, pytest.approx(-0.0731, abs=1e-4), pytest.approx(0.0731, abs=1e-4))
    low, high = mean_difference([4.0, 4.0], greatest=4)[1]
    assert -4.0 <= low < high == 4.0
    assert mean_difference([0.5, 0.5]) == (0.5, None)
    with pytest.raises(ValueError, match="at least one"):
        mean_difference([])


ULP = 2.0**-52


@pytest.mark.parametrize("values", [[1.0, 1.0 + ULP], [1.0 - ULP, 1.0, 1.0 + ULP], [-3e300, -3e300 * (1.0 + ULP)]])
def test_nearly_equal_differences_have_no_interval_of_nan(values):
    middle, interval = mean_difference(values)
    assert middle == pytest.approx(values[0], rel=1e-15)
    assert interval is None
    most = 4.0 * abs(values[0])
    equal = mean_difference([values[0]] * len(values), greatest=most)[1]
    assert mean_difference(values, greatest=most)[1] == pytest.approx(equal, rel=1e-14)


def test_differences_that_differ_by_more_than_rounding_have_an_interval():
    # With eight roundings between them, all four means of two are at hand.
    assert mean_difference([1.0, 1.0 + 8 * ULP])[1] == (1.0, 1.0 + 8 * ULP)


@pytest.mark.parametrize("power", [-1000, 990])
def test_huge_and_tiny_differences_have_the_interval_of_their_multiples(power):
    values = np.random.default_rng(2).normal(size=30)
    middle, (low, high) = mean_difference(values)
    expected = tuple(math.ldexp(bound, power) for bound in (low, high))
    assert mean_difference(np.ldexp(values, power)) == (math.ldexp(middle, power), expected)


def test_differences_whose_squares_are_infinite_have_an_interval():
    # Each sample of two has a mean of -1e300, 0 or 1e300, and the outer two have a probability of a quarter.
    assert mean_difference([1e300, -1e300]) == (0.0, (-1e300, 1e300))
    assert mean_difference([1.7e308, 1.7e308]) == (1.7e308, None)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_difference_that_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match=f"differences must be finite, got {value}"):
        mean_difference([1.0, value])


def test_holm_by_hand():
    # In order 0.005 x 4, 0.01 x 3, 0.03 x 2 = 0.06, and 0.04 x 1, which is not less than the one before.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.6, 0.9]) == [1.0, 1.0, 1.0]
    assert holm([0.04]) == [0.04]
    assert holm([]) == []


@pytest.mark.parametrize("seed", range(5))
def test_the_p_value_by_permutation_is_that_of_scipy(seed):
    totals = np.random.default_rng(seed).integers(-4, 5, 10)
    expected = stats.permutation_test((totals,), np.sum, permutation_type="samples", n_resamples=np.inf)
    assert permutation_p_value(totals) == pytest.approx(expected.pvalue)


@pytest.mark.parametrize(("wins", "losses"), [(0, 0), (4, 0), (3, 9), (150, 86), (1200, 1100)])
def test_the_p_value_of_clusters_of_one_episode_is_that_of_mcnemar(wins, losses):
    verdicts = PairedVerdicts(wins=wins, losses=losses, ties=5)
    totals = [1] * wins + [-1] * losses + [0] * 5
    assert permutation_p_value(totals) == pytest.approx(verdicts.p_value, rel=1e-9)


def test_equal_signs_of_few_clusters_prove_little():
    # All four kitchens for one policy: two of sixteen outcomes are as extreme, whatever their episodes.
    assert permutation_p_value([4, 4, 4, 4]) == 2 / 16
    assert permutation_p_value([1, 3, 2, 4]) == 2 / 16
    assert permutation_p_value([]) == 1.0


def test_clusters_are_resampled_as_wholes():
    generator = np.random.default_rng(3)
    rates = generator.normal(size=100)
    differences = np.repeat(rates, 4)
    clusters = np.repeat([f"kitchen {index}" for index in range(100)], 4)
    middle, interval = cluster_difference(differences, [*clusters])
    assert middle == pytest.approx(rates.mean())
    # Four equal episodes count as one: at 100 clusters the normal interval agrees within a tenth of its width.
    half = 1.96 * rates.std(ddof=1) / 10
    assert interval == pytest.approx((middle - half, middle + half), abs=0.2 * half)
    low, high = mean_difference(differences)[1]
    assert high - low == pytest.approx(half, rel=0.1)
    assert cluster_difference(-differences, [*clusters])[1] == pytest.approx((-interval[1], -interval[0]))


def test_clusters_of_other_sizes_have_the_mean_of_all_their_episodes():
    totals, sizes = cluster_totals([1, 0, -1, 1, 1], ["b", "a", "b", "a", "c"])
    assert (totals.tolist(), sizes.tolist()) == ([0, 1, 1], [2, 2, 1])
    middle, (low, high) = cluster_difference([1, 0, -1, 1, 1], ["b", "a", "b", "a", "c"])
    assert middle == pytest.approx(0.4)
    assert 0.0 <= low < middle < high <= 1.0


def test_equal_clusters_have_the_limits_of_so_many_clusters():
    differences, clusters = [0.0] * 400, [index // 4 for index in range(400)]
    assert cluster_difference(differences, clusters, greatest=1)[1] == mean_difference([0.0] * 100, greatest=1)[1]
    assert cluster_difference(differences, clusters) == (0.0, None)

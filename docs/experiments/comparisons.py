"""Simulates comparisons whose truth is known: how often intervals contain it, and how often equal policies differ.

python docs/experiments/comparisons.py methods    coverage with 2 to 10 training seeds, in a minute
python docs/experiments/comparisons.py kitchens   false alarms where kitchens are a sample, in some minutes

Results are in results/comparison_methods.json and comparison_kitchens.json; what has a row already is not simulated
again. Each row is of 2,000 pairs, by the functions that `compare` and `compare_methods` call, beside a naive method:
two-level resampling of training seeds and episodes, and episodes of one kitchen taken as independent.
"""

import math
from collections.abc import Iterator

import numpy as np
from experiment import RESULTS, Row, in_processes, measure_missing, run_named
from numpy.typing import NDArray
from scipy import stats

from kitchen_suite.evaluation.paired import (
    PairedVerdicts,
    cluster_difference,
    cluster_totals,
    permutation_p_value,
)
from kitchen_suite.evaluation.paired_scores import greater
from kitchen_suite.evaluation.training_seeds import method_difference

PAIRS = 2_000

# Of the protocols `default` and `unseen-kitchens`.
EPISODES = 200
KITCHENS = 100
KITCHEN_EPISODES = 4

SEEDS = (2, 3, 5, 10)

# By name, the success rates of two methods, and the standard deviations of what is added to the normal quantile of an
# episode's success: of the training seed, of the episode for both methods, and of the episode for one method.
METHODS = {
    "alike": ((0.8, 0.7), 0.0, 1.0, 0.0),
    "spread": ((0.8, 0.7), 0.3, 1.0, 0.5),
    "wide": ((0.8, 0.7), 0.8, 1.0, 0.5),
    "some collapse": ((0.97, 0.87), 1.0, 1.0, 0.0),
}

# Correlation of an equal policy's successes in a kitchen. The policy that comes with the package has 0.44 under
# `unseen-kitchens`, and the expert 0.41: docs/results/board.md.
CORRELATIONS = (0.0, 0.2, 0.4, 0.8)
RATE = 0.8

_RESAMPLES = 1_000
_LEVEL = 0.05


def draw_methods(
    case: str, seeds: int, pairs: int, generator: np.random.Generator
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yields the successes of both methods `(seeds, EPISODES)` in so many comparisons."""
    rates, seed_deviation, episode_deviation, own_deviation = METHODS[case]
    # So that the rates are those of the standard normal distribution.
    total = math.sqrt(1.0 + seed_deviation**2 + episode_deviation**2 + own_deviation**2)
    for _ in range(pairs):
        episode = episode_deviation * generator.normal(size=EPISODES)
        successes = []
        for rate in rates:
            own = own_deviation * generator.normal(size=EPISODES)
            seed = seed_deviation * generator.normal(size=(seeds, 1))
            noise = generator.normal(size=(seeds, EPISODES))
            successes.append((total * stats.norm.ppf(rate) + seed + episode + own + noise > 0.0).astype(np.float64))
        yield successes[0], successes[1]


def shares(count: int, generator: np.random.Generator) -> NDArray[np.float64]:
    """Returns what fraction of each sample with replacement is which of `count` `(_RESAMPLES, count)`."""
    return generator.multinomial(count, np.full(count, 1.0 / count), _RESAMPLES) / count


def resampled(
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    seeds: tuple[NDArray[np.float64], NDArray[np.float64]],
    episodes: NDArray[np.float64],
) -> tuple[float, float]:
    """Returns the naive interval: percentiles of the difference with seeds and episodes drawn with replacement."""
    one, other = (
        (share * (episodes @ values.T)).sum(axis=1) for share, values in zip(seeds, (first, second), strict=True)
    )
    low, high = np.quantile(one - other, [_LEVEL / 2.0, 1.0 - _LEVEL / 2.0])
    return float(low), float(high)


def simulate_methods(case: Row, pairs: int = PAIRS) -> Row:
    """Returns how many intervals contain the true difference of two methods, and their mean widths."""
    generator = np.random.default_rng([case["seeds"], [*METHODS].index(case["case"])])
    rate_a, rate_b = METHODS[case["case"]][0]
    found: dict[str, list[bool]] = {"coverage": [], "coverage_resampled": []}
    widths: dict[str, list[float]] = {"width": [], "width_resampled": []}
    deviations = []
    # The same samples in all pairs.
    of_seeds = shares(case["seeds"], generator), shares(case["seeds"], generator)
    of_episodes = shares(EPISODES, generator)
    for first, second in draw_methods(case["case"], case["seeds"], pairs, generator):
        estimate = method_difference(first, second, greatest=1.0)
        assert estimate.interval is not None
        naive = resampled(first, second, of_seeds, of_episodes)
        for name, (low, high) in (("", estimate.interval), ("_resampled", naive)):
            found[f"coverage{name}"].append(low <= rate_a - rate_b <= high)
            widths[f"width{name}"].append(high - low)
        deviations.append(first.mean(axis=1).var(ddof=1))
    return {
        "pairs": pairs,
        "seed_deviation": round(math.sqrt(np.mean(deviations)), 3),
        **{name: round(float(np.mean(values)), 4) for name, values in (found | widths).items()},
    }


def simulate_kitchens(case: Row, pairs: int = PAIRS) -> Row:
    """Returns in how many comparisons two equal policies are called different, by kitchens and by episodes."""
    correlation = case["correlation"]
    generator = np.random.default_rng([7, round(100 * correlation)])
    clusters = [*np.repeat(np.arange(KITCHENS), KITCHEN_EPISODES).tolist()]
    counts = {"alarms": 0, "alarms_p": 0, "alarms_interval": 0}
    naive = {f"{name}_episodes": 0 for name in counts}
    for _ in range(pairs):
        first, second = (draw_kitchens(correlation, generator) for _ in range(2))
        differences = first.astype(np.float64) - second
        middle, interval = cluster_difference(differences, clusters, greatest=1.0)
        p_value = permutation_p_value(cluster_totals(differences, clusters)[0])
        verdicts = PairedVerdicts.of(first, second)
        _count(counts, "", middle, interval, p_value)
        _count(naive, "_episodes", middle, verdicts.interval, verdicts.p_value)
    return {"pairs": pairs, **{name: round(count / pairs, 4) for name, count in (counts | naive).items()}}


def _count(counts: dict[str, int], suffix: str, middle: float, interval: tuple[float, float], p_value: float) -> None:
    counts[f"alarms{suffix}"] += greater(middle, interval, p_value) is not None
    counts[f"alarms_p{suffix}"] += p_value < _LEVEL
    counts[f"alarms_interval{suffix}"] += not interval[0] <= 0.0 <= interval[1]


def draw_kitchens(correlation: float, generator: np.random.Generator) -> NDArray[np.bool_]:
    """Returns the successes `(KITCHENS * KITCHEN_EPISODES,)` of a policy whose rate differs from kitchen to kitchen."""
    rates = np.full(KITCHENS, RATE)
    if correlation > 0.0:
        # A beta distribution whose variance is this fraction of that of a single episode.
        strength = 1.0 / correlation - 1.0
        rates = generator.beta(RATE * strength, (1.0 - RATE) * strength, KITCHENS)
    return (generator.random((KITCHENS, KITCHEN_EPISODES)) < rates[:, np.newaxis]).ravel()


def methods() -> None:
    """Simulates the comparisons of methods that are missing."""
    cases = [{"case": case, "seeds": seeds} for case in METHODS for seeds in SEEDS]
    measure_missing(RESULTS / "comparison_methods.json", cases, simulate_methods, in_processes)


def kitchens() -> None:
    """Simulates the comparisons in kitchens that are missing."""
    cases = [{"correlation": correlation} for correlation in CORRELATIONS]
    measure_missing(RESULTS / "comparison_kitchens.json", cases, simulate_kitchens, in_processes)


if __name__ == "__main__":
    run_named(__doc__, {"methods": methods, "kitchens": kitchens})

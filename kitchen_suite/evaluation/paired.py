"""Statistics of two policies that played the same episodes.

Comparing each episode with its partner removes what makes an episode hard for both policies, such as its start, so that
fewer episodes show the same difference than with two samples of different episodes. Where episodes are in clusters,
such as kitchens, whole clusters are compared.
"""

import dataclasses
import math
from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats

from kitchen_suite.evaluation.scores import CONFIDENCE, Interval, are_equal, possible_means, scale

# Random numbers of the bootstrap, so that the same episodes have the same interval.
_SEED = 0
_RESAMPLES = 9_999

# Numbers that the bootstrap holds at once: 80 MB.
_BATCH_NUMBERS = 10**7

# Distance from the observed difference at which the search of a limit begins: where no episode differs, the statistic
# of the difference 0 is undefined.
_GAP = 1e-9


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairedVerdicts:
    """How often one of two policies reached what the other did not, in the same episodes.

    Attributes:
      wins: number of episodes in which the first policy alone succeeded.
      losses: number of episodes in which the second policy alone succeeded.
      ties: number of episodes in which both succeeded or both failed.
    """

    wins: int
    losses: int
    ties: int

    @classmethod
    def of(cls, first: ArrayLike, second: ArrayLike) -> "PairedVerdicts":
        """Counts the verdicts `(n,)` of two policies on the same `n` episodes, at least one."""
        one = np.asarray(first, bool)
        other = np.asarray(second, bool)
        if one.shape != other.shape or not one.size:
            raise ValueError(f"verdicts of shapes {one.shape} and {other.shape} are no pairs")
        wins = int(np.count_nonzero(one & ~other))
        losses = int(np.count_nonzero(~one & other))
        return cls(wins=wins, losses=losses, ties=one.size - wins - losses)

    @property
    def count(self) -> int:
        """Number of episodes."""
        return self.wins + self.losses + self.ties

    @property
    def difference(self) -> float:
        """The first policy's success rate less the second's, from -1 to 1."""
        return (self.wins - self.losses) / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the difference, see `score_interval`."""
        return score_interval(self.wins, self.losses, self.count)

    @property
    def p_value(self) -> float:
        """The exact p-value of McNemar's test that both policies succeed equally often; 1 without wins and losses."""
        decided = self.wins + self.losses
        return float(stats.binomtest(self.wins, decided).pvalue) if decided else 1.0


def score_interval(wins: int, losses: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Returns Tango's score interval of the difference of two success rates on the same episodes.

    It is to paired rates what Wilson's interval is to one rate: it stays between -1 and 1, has a width where all
    episodes are ties, and contains 0 exactly where McNemar's asymptotic test does not reject. Source: T. Tango,
    Equivalence test and confidence interval for the difference in proportions for the paired-sample design, Statistics
    in Medicine 17 (1998) 891-908.

    Args:
      wins: number of episodes in which the first policy alone succeeded.
      losses: number of episodes in which the second policy alone succeeded.
      count: number of all episodes.
      confidence: probability with which the interval contains the true difference.
    """
    quantile = float(stats.norm.ppf((1.0 + confidence) / 2.0))
    return _lower_limit(wins, losses, count, quantile), -_lower_limit(losses, wins, count, quantile)


def _lower_limit(wins: int, losses: int, count: int, quantile: float) -> float:
    """Returns the difference, at most the observed one, whose score statistic is a quantile of the normal."""

    def excess(difference: float) -> float:
        """Returns the deviation of the observed difference, less as many standard deviations as the quantile."""
        slope = (2 * count - wins + losses) * difference - wins - losses
        constant = -losses * difference * (1.0 - difference)
        # The likeliest probability, given this difference, that the second policy alone succeeds.
        root = math.sqrt(max(0.0, slope**2 - 8.0 * count * constant))
        only_second = (root - slope) / (4.0 * count)
        variance = count * (2.0 * only_second + difference * (1.0 - difference))
        return wins - losses - count * difference - quantile * math.sqrt(max(0.0, variance))

    nearest = max(-1.0, (wins - losses) / count - _GAP)
    return float(optimize.brentq(excess, -1.0, nearest))


def mean_difference(differences: ArrayLike, *, greatest: float = math.inf) -> tuple[float, Interval]:
    """Returns the mean of the differences `(n,)` of paired episodes, and its interval.

    The interval is that of SciPy's bootstrap over episodes, bias-corrected and accelerated, with fixed random numbers.
    Where all differences are equal, as in `scores.are_equal`, it is that of `scores.possible_means`; None where
    `greatest` is infinite.

    Args:
      differences: of the episodes, finite.
      greatest: absolute value that no difference exceeds.
    """
    values = np.asarray(differences, np.float64)
    if not values.size:
        raise ValueError("a mean difference needs at least one pair of episodes")
    if not np.isfinite(values).all():
        raise ValueError(f"differences must be finite, got {values[~np.isfinite(values)][0]}")
    scaled, exponent = scale(values)
    middle = math.ldexp(scaled.mean(), exponent)
    if are_equal(values):
        return middle, possible_means(middle, values.size, low=-greatest, high=greatest)
    low, high = _bootstrap(scaled)
    return middle, (math.ldexp(low, exponent), math.ldexp(high, exponent))


def cluster_difference(
    differences: ArrayLike, clusters: Sequence[Hashable], *, greatest: float = math.inf
) -> tuple[float, Interval]:
    """Returns the mean of the differences `(n,)` of paired episodes in clusters, such as kitchens, and its interval.

    Episodes of a cluster are more alike than those of two, so that SciPy's bootstrap draws whole clusters, and the
    interval is that of all clusters that could have been drawn. All else is as in `mean_difference`.

    Args:
      differences: of the episodes, finite.
      clusters: to which each of them belongs.
      greatest: absolute value that no difference exceeds.
    """
    totals, sizes = cluster_totals(differences, clusters)
    scaled, exponent = scale(totals)
    middle = math.ldexp(scaled.sum() / sizes.sum(), exponent)
    if are_equal(totals / sizes):
        return middle, possible_means(middle, sizes.size, low=-greatest, high=greatest)
    low, high = _bootstrap(scaled, sizes)
    return middle, (math.ldexp(low, exponent), math.ldexp(high, exponent))


def cluster_totals(values: ArrayLike, clusters: Sequence[Hashable]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the sum of the values `(n,)` in each cluster `(k,)`, and how many values each has `(k,)`."""
    places: dict[Hashable, int] = {}
    indices = [places.setdefault(cluster, len(places)) for cluster in clusters]
    totals = np.bincount(indices, weights=np.asarray(values, np.float64)).astype(np.float64)
    return totals, np.bincount(indices).astype(np.float64)


def permutation_p_value(totals: ArrayLike) -> float:
    """Returns the exact p-value of the test that swaps both policies in whole clusters.

    Between equal policies the sign of each cluster's total is a coin. The p-value is the probability that the sum of
    totals with such signs is as far from 0 as the observed one: of all `2^k` signs, which are not drawn, but counted by
    their sums. With one episode in each cluster it is McNemar's exact one. Source: R. A. Fisher, The Design of
    Experiments (1935), chapter 3.

    Args:
      totals: wins less losses in each cluster `(k,)`, whole numbers.
    """
    wholes = np.asarray(totals, np.int64)
    # Probabilities of the sums of those totals whose coin shows heads.
    probabilities = np.ones(1)
    for total in np.abs(wholes[wholes != 0]):
        tails, heads = np.pad(probabilities, (0, total)), np.pad(probabilities, (total, 0))
        probabilities = (tails + heads) / 2.0
    greatest = probabilities.size - 1
    sums = 2 * np.arange(probabilities.size) - greatest
    return min(1.0, float(probabilities[np.abs(sums) >= abs(wholes.sum())].sum()))


def _bootstrap(values: NDArray[np.float64], sizes: NDArray[np.float64] | None = None) -> tuple[float, float]:
    """Returns the limits of the mean of values `(n,)`, or of the sum of values per size, both of clusters."""
    result = stats.bootstrap(
        (values,) if sizes is None else (values, sizes),
        np.mean if sizes is None else _ratio,
        paired=sizes is not None,
        confidence_level=CONFIDENCE,
        n_resamples=_RESAMPLES,
        batch=max(1, _BATCH_NUMBERS // values.size),
        random_state=np.random.default_rng(_SEED),
    )
    interval = result.confidence_interval
    return float(interval.low), float(interval.high)


def _ratio(totals: NDArray[np.float64], sizes: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    quotients: NDArray[np.float64] = totals.sum(axis=axis) / sizes.sum(axis=axis)
    return quotients


def holm(p_values: Sequence[float]) -> list[float]:
    """Returns p-values adjusted for being several, by Holm's method, in their order.

    Whoever rejects those below 5 % rejects any true hypothesis with a probability of at most 5 %. Source: S. Holm, A
    simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6 (1979) 65-70.
    """
    adjusted = [1.0] * len(p_values)
    greatest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        greatest = max(greatest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = greatest
    return adjusted

"""Statistics of methods, each of several training seeds, whose policies all played the same episodes.

A method's score depends on two draws: the training seeds, which make policies, and the episodes. Each training seed
belongs to one method, and each episode was played by every policy. In diagnostic radiology this is the design of many
readers, each of one test, and the same cases: training seeds are the readers, episodes the cases. Source: S. L. Hillis,
A marginal-mean ANOVA approach for analyzing multireader multicase radiological imaging data, Statistics in Medicine 33
(2014) 330-360, for unequal numbers of seeds as in B. L. Welch, The generalization of 'Student's' problem, Biometrika 34
(1947) 28-35.

Resampling seeds and episodes is the same idea, but with few seeds its intervals are too short: see
`docs/experiments/comparisons.py`, which measures both.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from kitchen_suite.evaluation.scores import CONFIDENCE, Interval, possible_means, scale


class Estimate(NamedTuple):
    """An estimate of a mean, or of a difference of means.

    Attributes:
      value: the estimate.
      interval: its 95 % interval.
      p_value: probability of a value as far from 0, or farther, if the true value is 0.
    """

    value: float
    interval: Interval
    p_value: float


class _Variance(NamedTuple):
    """Estimated variances of the mean of a method.

    Attributes:
      seeds: of training seeds, and of what each did in each episode.
      single: the part of it of what each seed did in each episode.
      degrees: degrees of freedom of `seeds`.
    """

    seeds: float
    single: float
    degrees: int


def method_mean(values: NDArray[np.float64], *, low: float = -math.inf, high: float = math.inf) -> Estimate:
    """Returns the mean of a method, over the training seeds and the episodes that could have been drawn.

    Args:
      values: of the episodes of each training seed `(seeds, episodes)`, at least two of both.
      low: least possible value, at which the interval is cut off.
      high: greatest possible value, at which the interval is cut off.
    """
    return _estimate([values], values.mean(axis=0), low, high)


def method_difference(
    first: NDArray[np.float64], second: NDArray[np.float64], *, greatest: float = math.inf
) -> Estimate:
    """Returns the first method's mean less the second's.

    Args:
      first: values of the episodes of each training seed `(seeds, episodes)`, at least two of both.
      second: values of the other method's training seeds, which may be more or fewer, in the same episodes.
      greatest: absolute value that no difference exceeds.
    """
    return _estimate([first, second], first.mean(axis=0) - second.mean(axis=0), -greatest, greatest)


def _estimate(methods: list[NDArray[np.float64]], by_episode: NDArray[np.float64], low: float, high: float) -> Estimate:
    """Returns the mean of means or differences by episode `(episodes,)` of one or two methods."""
    count = by_episode.size
    _, exponent = scale(np.concatenate([each.ravel() for each in methods]))
    parts = [_variance(np.ldexp(each, -exponent)) for each in methods]
    scaled = np.ldexp(by_episode, -exponent)
    middle = float(scaled.mean())
    value = math.ldexp(middle, exponent)
    rounding = (count * np.finfo(np.float64).eps) ** 2
    # What all seeds of a method have in common in an episode; the noise of single ones is in the variance of seeds.
    episodes = max(0.0, float(scaled.var(ddof=1)) / count - sum(part.single for part in parts))
    variance = episodes + sum(part.seeds for part in parts)
    squares = episodes**2 / (count - 1) + sum(part.seeds**2 / part.degrees for part in parts)
    if variance <= rounding:
        # By chance all seeds have the same mean: single episodes have noise all the same.
        variance = sum(part.single for part in parts)
        squares = sum(part.single**2 / (part.degrees * (count - 1)) for part in parts)
    if variance <= rounding:
        p_value = 1.0 if middle == 0.0 else min(1.0, 2.0 * 0.5**count)
        return Estimate(value, possible_means(value, count, low=low, high=high), p_value)
    student = stats.t(variance**2 / squares)
    error = math.sqrt(variance)
    half = math.ldexp(float(student.isf((1.0 - CONFIDENCE) / 2.0)) * error, exponent)
    interval = max(low, value - half), min(high, value + half)
    return Estimate(value, interval, float(2.0 * student.sf(abs(middle) / error)))


def _variance(values: NDArray[np.float64]) -> _Variance:
    """Returns the variances of a method's mean from its values `(seeds, episodes)`."""
    seeds, episodes = values.shape
    means = values.mean(axis=1)
    residuals = values - means[:, np.newaxis] - values.mean(axis=0) + values.mean()
    single = float((residuals**2).sum()) / ((seeds - 1) * (episodes - 1))
    return _Variance(float(means.var(ddof=1)) / seeds, single / (seeds * episodes), seeds - 1)

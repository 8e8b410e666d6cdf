"""Scores of episodes, from arrays of their completions, and confidence intervals of the scores.

Of `n` episodes with `k` tasks, `asked` is `(n, k)` bool, and `steps` is `(n, k)`, the control step, from 1, at which a
task was first completed, and not positive where it was not.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

# Probability with which an interval contains the true value.
CONFIDENCE = 0.95

_TAIL = (1.0 + CONFIDENCE) / 2.0

# An interval: its least and its greatest value; None where episodes are too few for one.
Interval = tuple[float, float] | None


def rate(verdicts: ArrayLike) -> tuple[float, Interval]:
    """Returns the share of true verdicts `(n,)`, and its interval by Wilson's method.

    Raises:
      ValueError: there is no verdict.
    """
    true = np.asarray(verdicts, bool)
    if not true.size:
        raise ValueError("a rate needs at least one episode")
    return float(true.mean()), wilson(int(true.sum()), true.size)


def wilson(successes: int, count: int) -> tuple[float, float]:
    """Returns Wilson's score interval of the probability of success, given the successes of `count` trials."""
    z = float(special.ndtri(_TAIL))
    centre = (successes + z**2 / 2) / (count + z**2)
    half = z / (count + z**2) * math.sqrt(successes * (count - successes) / count + z**2 / 4)
    # The bounds of all failures and all successes are 0 and 1; rounding would miss them.
    low = 0.0 if successes == 0 else centre - half
    return low, 1.0 if successes == count else centre + half


def mean(values: ArrayLike, *, low: float = -math.inf, high: float = math.inf) -> tuple[float, Interval]:
    """Returns the mean of values `(n,)`, and its interval by Student's t; None for the interval of one value.

    Args:
      values: of the episodes.
      low: least possible value, at which the interval is cut off.
      high: greatest possible value, at which the interval is cut off.

    Raises:
      ValueError: there is no value.
    """
    numbers = np.asarray(values, np.float64)
    if not numbers.size:
        raise ValueError("a mean needs at least one episode")
    middle = float(numbers.mean())
    if numbers.size == 1:
        return middle, None
    half = float(special.stdtrit(numbers.size - 1, _TAIL)) * float(numbers.std(ddof=1)) / math.sqrt(numbers.size)
    return middle, (max(low, middle - half), min(high, middle + half))


def tasks_completed(asked: NDArray[np.bool_], steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns the number of asked tasks `(n,)` that each episode completed."""
    return np.count_nonzero(asked & (steps > 0), axis=1)


def at_least(completed: NDArray[np.int64], most: int) -> dict[str, NDArray[np.bool_]]:
    """Returns which episodes `(n,)` completed at least 1 to `most` tasks, by `p1` to `pN`."""
    return {f"p{number}": completed >= number for number in range(1, most + 1)}


def order_entropy(asked: NDArray[np.bool_], steps: NDArray[np.int64]) -> float:
    """Returns the entropy of the order in which episodes complete asked tasks [bit].

    It is the entropy of the empirical distribution of the sequences of completed tasks, whatever their length; at most
    `log2(n)`. Tasks completed in one control step are in the order of the columns.
    """
    done = asked & (steps > 0)
    places = np.argsort(np.where(done, steps, np.iinfo(np.int64).max), axis=1, kind="stable")
    sequences = np.where(np.take_along_axis(done, places, axis=1), places, -1)
    _, counts = np.unique(sequences, axis=0, return_counts=True)
    shares = counts / counts.sum()
    return abs(float((shares * np.log2(shares)).sum()))

"""The results of single episodes, as they are kept, and the scores of many."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from kitchen_suite.evaluation import quality
from kitchen_suite.evaluation.protocols import Score
from kitchen_suite.tasks.task import SuiteTask

# Probability with which an interval contains the true value.
CONFIDENCE = 0.95

MAX_SEED = 2**63 - 1  # Of results: msgspec has 64 bits.

# Greatest progress or measure of an episode: sums, differences and intervals of many such numbers are finite.
_MAX_NUMBER = 1e300

# An interval: its least and its greatest value; None where episodes are too few for one.
Interval = tuple[float, float] | None

Count = Annotated[int, Meta(ge=0, le=MAX_SEED)]

# Decimals of the scores; those beyond would differ between versions of SciPy.
_DECIMALS = 6


def rate(verdicts: ArrayLike) -> tuple[float, Interval]:
    """Returns the share of true verdicts `(n,)`, and its interval by Wilson's method."""
    true = np.asarray(verdicts, bool)
    if not true.size:
        raise ValueError("a rate needs at least one episode")
    return float(true.mean()), wilson(int(true.sum()), true.size)


def wilson(successes: int, count: int) -> tuple[float, float]:
    """Returns Wilson's score interval of the probability of success, given the successes of `count` trials."""
    interval = stats.binomtest(successes, count).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def mean(values: ArrayLike, *, low: float = -math.inf, high: float = math.inf) -> tuple[float, Interval]:
    """Returns the mean of values `(n,)`, and its interval by Student's t; None for the interval of one value.

    The interval of values that `are_equal` is that of `possible_means`.

    Args:
      values: of the episodes.
      low: least possible value, at which the interval is cut off.
      high: greatest possible value, at which the interval is cut off.
    """
    numbers = np.asarray(values, np.float64)
    if not numbers.size:
        raise ValueError("a mean needs at least one episode")
    scaled, exponent = scale(numbers)
    scaled_middle = float(scaled.mean())
    middle = math.ldexp(scaled_middle, exponent)
    if numbers.size == 1:
        return middle, None
    if are_equal(numbers):
        return middle, possible_means(middle, numbers.size, low=low, high=high)
    limits = stats.t.interval(CONFIDENCE, numbers.size - 1, scaled_middle, float(stats.sem(scaled)))
    least, greatest = (math.ldexp(limit, exponent) for limit in limits)
    return middle, (max(float(low), least), min(float(high), greatest))


def scale(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """Returns values `(n,)` divided by a power of two, so that all are below 1, and its exponent for `math.ldexp`.

    Powers of huge numbers would be infinite, and those of tiny ones 0. To divide by a power of two changes no digit.
    """
    _, exponent = math.frexp(np.abs(values).max())
    return np.ldexp(values, -exponent), exponent


def are_equal(values: NDArray[np.float64]) -> bool:
    """Returns whether values `(n,)` differ by no more than the rounding of their mean."""
    rounding = values.size * np.finfo(np.float64).eps
    scaled, _ = scale(values)
    return bool(np.ptp(scaled) <= rounding * np.abs(scaled).max())


def possible_means(value: float, count: int, *, low: float, high: float) -> Interval:
    """Returns an interval of the mean where `count` episodes have all had the same value.

    An interval from their deviations would have no width, as if nothing else could happen. This one contains every mean
    that is possible while other values have at most the probability that the exact binomial limit leaves them. It is
    None where the values have no bounds `low` and `high`.
    """
    if not math.isfinite(high - low):
        return None
    unseen = 1.0 - ((1.0 - CONFIDENCE) / 2.0) ** (1.0 / count)
    return value - unseen * (value - low), value + unseen * (high - value)


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


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """The result of an episode.

    Attributes:
      condition: name of the condition of its protocol.
      episode: its number in the condition, from 0.
      seed: of the episode.
      success: whether it succeeded.
      progress: how far it came, as its task measures it.
      control_steps: its length.
      asked: the tasks that it asked for, each with the control step of its completion or None; None for tasks that
        cannot be counted.
      diverged: whether its physics diverged; it then counts as a failure of the greatest length, at its start.
      success_at_end: whether all that it asked for held after its last control step; None where that was not kept, as
        by version 1.0.
      steps_to_success: control step at which it first succeeded, 0 for the reset; None if it never did, or where that
        was not kept.
      measures: further measures of its protocol by name.
      reset: options of its reset, as JSON; empty where its seed says it all.
    """

    condition: str
    episode: Count
    seed: Count
    success: bool
    progress: float
    control_steps: Count
    asked: dict[str, Count | None] | None = None
    diverged: bool = False
    success_at_end: bool | None = None
    steps_to_success: Count | None = None
    measures: dict[str, bool | float] = dataclasses.field(default_factory=dict)
    reset: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raises a ValueError unless all numbers are finite, of which scores and intervals can be made."""
        for name, value in {"progress": self.progress, **self.measures}.items():
            # False for NaN.
            if not abs(value) <= _MAX_NUMBER:
                problem = f"{name} of the episode of seed {self.seed} is {value}"
                raise ValueError(f"{problem}: it must be a number from -{_MAX_NUMBER:g} to {_MAX_NUMBER:g}")

    @classmethod
    def of(cls, task: SuiteTask, infos: Mapping[str, Any], *, control_steps: int, **others: Any) -> "EpisodeResult":
        """Returns an episode's result from the last infos of its task, without leading axis, and other attributes."""
        completions = task.records.completions(infos)
        return cls(
            success=bool(infos["is_success"]),
            progress=float(task.records.progress(infos)),
            control_steps=control_steps,
            asked=completions.steps_by_task if completions else None,
            **others,
        )

    def with_fields_of(self, other: "EpisodeResult") -> "EpisodeResult":
        """Returns the result without what another one does not say."""
        if other.success_at_end is not None:
            return self
        return dataclasses.replace(self, success_at_end=None, steps_to_success=None)

    def as_json(self) -> dict[str, Any]:
        """Returns the result as JSON represents it; without what was not kept, as version 1.0 wrote it."""
        record = dataclasses.asdict(self)
        if self.success_at_end is None:
            del record["success_at_end"], record["steps_to_success"]
        return record


def score_episodes(
    results: Sequence[EpisodeResult], score: Score | None = None, max_episode_steps: float = math.inf
) -> dict[str, Any]:
    """Returns the scores of the episodes of a condition, as JSON represents them.

    Args:
      results: at least one, in the order of their numbers.
      score: a published score; only for tasks that can be counted.
      max_episode_steps: control steps after which an episode ends.
    """
    measured: dict[str, tuple[float, Interval]] = {}
    further: dict[str, Any] = {}
    if all(result.asked is not None for result in results):
        asked, steps, tasks = _arrays(results)
        completed = tasks_completed(asked, steps)
        most = int(asked.sum(axis=1).max())
        reached = at_least(completed, most)
        measured |= {name: rate(verdicts) for name, verdicts in reached.items()}
        measured["mean_tasks"] = mean(completed, low=0.0, high=most)
        if score:
            measured[score.name] = mean(completed / score.tasks * score.best, low=0.0, high=score.best)
        further["task_rates"] = {
            name: _task_rate(steps[asked[:, column], column] > 0) for column, name in enumerate(tasks)
        }
        further["order_entropy"] = round(order_entropy(asked, steps), _DECIMALS)
    else:
        measured["mean_progress"] = mean([result.progress for result in results])
    for name, example in results[0].measures.items():
        values = [result.measures[name] for result in results]
        measured[name] = (
            rate(values) if isinstance(example, bool) else mean(values, low=quality.least_values().get(name, -math.inf))
        )
    measured["success"] = rate([result.success for result in results])
    measured |= _lasting(results, max_episode_steps)
    measured["control_steps"] = mean([result.control_steps for result in results], low=1.0, high=max_episode_steps)
    return {
        **{name: round(value, _DECIMALS) for name, (value, _) in measured.items()},
        "intervals": {name: _rounded(interval) for name, (_, interval) in measured.items()},
        **further,
        "diverged_seeds": [result.seed for result in results if result.diverged],
    }


def _lasting(results: Sequence[EpisodeResult], max_episode_steps: float) -> dict[str, tuple[float, Interval]]:
    """Returns how many episodes end in success, and how soon those that reach it do; nothing where it was not kept."""
    at_end = [result.success_at_end for result in results if result.success_at_end is not None]
    if not at_end:
        return {}
    measured = {"success_at_end": rate(at_end)}
    steps = [result.steps_to_success for result in results if result.steps_to_success is not None]
    if steps:
        measured["steps_to_success"] = mean(steps, low=0.0, high=max_episode_steps)
    return measured


def score_sample(scores: Mapping[str, Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Returns the means of some rates over conditions that are a sample, as JSON represents them.

    Their intervals are those of the mean over all conditions that could have been drawn: episodes of one condition,
    such as a kitchen, are more alike than those of two.
    """
    means = {name: mean([each[name] for each in scores.values()], low=0.0, high=1.0) for name in names}
    return {
        **{name: round(value, _DECIMALS) for name, (value, _) in means.items()},
        "intervals": {name: _rounded(interval) for name, (_, interval) in means.items()},
        "diverged_seeds": [seed for each in scores.values() for seed in each["diverged_seeds"]],
    }


def _arrays(results: Sequence[EpisodeResult]) -> tuple[NDArray[np.bool_], NDArray[np.int64], list[str]]:
    """Returns which tasks `(n, k)` episodes ask for, their completion steps `(n, k)`, and the tasks' names in order."""
    rows = [result.asked or {} for result in results]
    tasks = sorted({name for row in rows for name in row})
    asked = np.array([[name in row for name in tasks] for row in rows], bool)
    return asked, np.array([[row.get(name) or -1 for name in tasks] for row in rows], np.int64), tasks


def _task_rate(completed: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns how often a task was completed in the episodes `(n,)` that asked for it."""
    value, interval = rate(completed)
    counts = {"asked": completed.size, "completed": int(completed.sum())}
    return {"rate": round(value, _DECIMALS), "interval": _rounded(interval), **counts}


def _rounded(interval: Interval) -> list[float] | None:
    return None if interval is None else [round(bound, _DECIMALS) for bound in interval]

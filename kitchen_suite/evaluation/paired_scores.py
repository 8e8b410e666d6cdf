"""Scores of two policies that played the same episodes, a row each, with what the text and the JSON show of it."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from kitchen_suite.evaluation import quality
from kitchen_suite.evaluation.paired import (
    PairedVerdicts,
    cluster_difference,
    cluster_totals,
    holm,
    mean_difference,
    permutation_p_value,
)
from kitchen_suite.evaluation.scores import EpisodeResult, Interval

Pair = tuple[EpisodeResult, EpisodeResult]
"""The results of two policies in the same episode."""

RATE = "%"
"""Unit of the scores that are rates, from 0 to 1 in JSON, and which text shows in hundredths."""

# Decimals of differences and rates, as of all scores, and significant digits of p-values.
_DECIMALS = 6
_DIGITS = 6

# Probability of calling one of two equal policies better.
_LEVEL = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairedScore:
    """A score of two policies in the same episodes.

    Attributes:
      episodes: their number.
      a: score of the first policy.
      b: score of the second policy.
      difference: the first policy's score less the second's.
      interval: the 95 % interval of the difference.
      unit: `RATE`, or the unit of the numbers as text shows it; empty for none.
      p_value: probability of such a difference, or a larger one, between equal policies; None where it is not computed.
      p_value_holm: the p-value adjusted by Holm's method, where it is one of several; else None.
      verdicts: in how many episodes one policy alone reached it; None for means.
    """

    episodes: int
    a: float
    b: float
    difference: float
    interval: Interval
    unit: str = ""
    p_value: float | None = None
    p_value_holm: float | None = None
    verdicts: PairedVerdicts | None = None

    @classmethod
    def of_verdicts(
        cls, pairs: Sequence[Pair], verdict: Callable[[EpisodeResult], float], *, by_condition: bool = False
    ) -> "PairedScore":
        """Returns how often each policy reached what a function of the result is true for.

        With `by_condition` conditions are a sample, such as kitchens, and are resampled, in place of episodes.
        """
        first = [bool(verdict(one)) for one, _ in pairs]
        second = [bool(verdict(other)) for _, other in pairs]
        counted = PairedVerdicts.of(first, second)
        interval: Interval = counted.interval
        p_value = counted.p_value
        if by_condition:
            differences = np.subtract(first, second, dtype=np.float64)
            _, interval = cluster_difference(differences, _conditions(pairs), greatest=1.0)
            p_value = permutation_p_value(cluster_totals(differences, _conditions(pairs))[0])
        return cls(
            episodes=len(pairs),
            a=sum(first) / len(pairs),
            b=sum(second) / len(pairs),
            difference=counted.difference,
            interval=interval,
            unit=RATE,
            p_value=p_value,
            verdicts=counted,
        )

    @classmethod
    def of_means(
        cls,
        pairs: Sequence[Pair],
        value: Callable[[EpisodeResult], float],
        *,
        greatest: float = math.inf,
        unit: str = "",
        by_condition: bool = False,
    ) -> "PairedScore":
        """Returns the means of a function of the result, whose differences are at most `greatest`."""
        differences = [value(one) - value(other) for one, other in pairs]
        if by_condition:
            difference, interval = cluster_difference(differences, _conditions(pairs), greatest=greatest)
        else:
            difference, interval = mean_difference(differences, greatest=greatest)
        return cls(
            episodes=len(pairs),
            a=sum(value(one) for one, _ in pairs) / len(pairs),
            b=sum(value(other) for _, other in pairs) / len(pairs),
            difference=difference,
            interval=interval,
            unit=unit,
        )

    @property
    def greater(self) -> Literal["a", "b"] | None:
        """The policy whose score is shown to be greater: p is below 0.05, and the interval excludes 0; else None."""
        return greater(self.difference, self.interval, self.p_value)

    def as_json(self) -> dict[str, Any]:
        """Returns the score as JSON represents it."""
        row: dict[str, Any] = {
            "episodes": self.episodes,
            "a": rounded(self.a),
            "b": rounded(self.b),
            "difference": rounded(self.difference),
            "interval": rounded_interval(self.interval),
        }
        if self.verdicts is not None:
            row |= dataclasses.asdict(self.verdicts)
        if self.p_value is not None:
            row["p_value"] = significant(self.p_value)
        if self.p_value_holm is not None:
            row["p_value_holm"] = significant(self.p_value_holm)
        return row


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeScore:
    """A score of an episode, of which comparisons have a row.

    Attributes:
      of: the score of a result; a verdict if its unit is `RATE`.
      unit: as of `PairedScore`.
      low: least possible score.
      high: greatest possible score.
    """

    of: Callable[[EpisodeResult], float]
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf


def episode_scores(policies: Sequence[Sequence[EpisodeResult]]) -> dict[str, EpisodeScore]:
    """Returns the scores by which policies are compared, `success` first, given the results of each.

    They are those of `scores.score_episodes` that every episode has, without the rates of p1 to pN and the lengths.
    """
    scores = {"success": EpisodeScore(of=lambda result: result.success, unit=RATE, low=0.0, high=1.0)}
    example, *others = (results[0] for results in policies)
    # Evaluations of version 1.0 do not say it.
    if None not in {each.success_at_end for each in (example, *others)}:
        scores["success_at_end"] = EpisodeScore(of=_success_at_end, unit=RATE, low=0.0, high=1.0)
    if example.asked is None:
        scores["mean_progress"] = EpisodeScore(of=lambda result: result.progress)
    else:
        most = max(len(result.asked or {}) for result in policies[0])
        scores["mean_tasks"] = EpisodeScore(of=_tasks, low=0.0, high=float(most))
    for name, value in example.measures.items():
        # One of them may measure more, such as its quality.
        if all(name in other.measures for other in others):
            if isinstance(value, bool):
                scores[name] = EpisodeScore(of=_measure(name), unit=RATE, low=0.0, high=1.0)
            else:
                scores[name] = EpisodeScore(of=_measure(name), low=quality.least_values().get(name, -math.inf))
    return scores


def paired_scores(pairs: Sequence[Pair], *, by_condition: bool = False) -> dict[str, PairedScore]:
    """Returns the scores of some episodes by name, `success` first; see `PairedScore.of_verdicts`.

    The last, `steps_to_success`, is of the episodes in which both succeed; there is none without these, and none of
    evaluations of version 1.0, which do not say it.
    """
    rows = {}
    for name, score in episode_scores([*zip(*pairs, strict=True)]).items():
        if score.unit == RATE:
            rows[name] = PairedScore.of_verdicts(pairs, score.of, by_condition=by_condition)
        else:
            greatest = score.high - score.low
            rows[name] = PairedScore.of_means(
                pairs, score.of, greatest=greatest, unit=score.unit, by_condition=by_condition
            )
    if both := [pair for pair in pairs if all(result.steps_to_success is not None for result in pair)]:
        rows["steps_to_success"] = PairedScore.of_means(both, _steps_to_success, by_condition=by_condition)
    return rows


def paired_task_rates(pairs: Sequence[Pair], *, by_condition: bool = False) -> dict[str, PairedScore]:
    """Returns how often each task was completed where it was asked, with p-values adjusted for their number."""
    by_task: dict[str, list[Pair]] = {}
    for one, other in pairs:
        for name in one.asked or {}:
            by_task.setdefault(name, []).append((one, other))
    rates = {
        name: PairedScore.of_verdicts(by_task[name], _completed(name), by_condition=by_condition)
        for name in sorted(by_task)
    }
    return adjusted(rates)


def paired_conditions(
    results: Mapping[str, Sequence[EpisodeResult]], control: str
) -> dict[str, dict[str, PairedScore]]:
    """Returns the scores of the other conditions less those of the control arm, in episodes of the same seed.

    They are by condition, `a` is the condition, `b` the control arm, and p-values are adjusted for their number.
    """
    rows = {
        name: paired_scores([*zip(each, results[control], strict=True)])
        for name, each in results.items()
        if name != control
    }
    success = adjusted({name: scores["success"] for name, scores in rows.items()})
    return {name: {**scores, "success": success[name]} for name, scores in rows.items()}


def adjusted(scores: Mapping[str, PairedScore]) -> dict[str, PairedScore]:
    """Returns scores with their p-values adjusted for being several."""
    p_values = holm([score.p_value for score in scores.values() if score.p_value is not None])
    pairs = zip(scores.items(), p_values, strict=True)
    return {name: dataclasses.replace(score, p_value_holm=p_value) for (name, score), p_value in pairs}


def greater(difference: float, interval: Interval, p_value: float | None) -> Literal["a", "b"] | None:
    """Returns the side whose score is shown to be greater, by p and by the interval; None where neither is."""
    if p_value is None or p_value >= _LEVEL or interval is None or interval[0] <= 0.0 <= interval[1]:
        return None
    return "a" if difference > 0.0 else "b"


def conclusion(difference: float, interval: Interval, p_value: float, names: tuple[str, str], unit: str) -> str:
    """Returns a sentence on which of two succeeds more often, if their episodes, or other units, show that.

    Exact p-values and intervals may disagree where little decides: then no difference is shown.
    """
    assert interval is not None
    low, high = (100.0 * bound for bound in interval)
    match greater(difference, interval, p_value):
        case "a":
            return f"{names[0]} succeeds more often, by {low:.1f} to {high:.1f} percentage points"
        case "b":
            return f"{names[1]} succeeds more often, by {-high:.1f} to {-low:.1f} percentage points"
    found = f"{low:+.1f} to {high:+.1f} percentage points"
    if p_value < _LEVEL:
        return f"no difference is shown: p is below {_LEVEL}, but the interval, {found}, contains 0"
    if low <= 0.0 <= high:
        return f"no difference is shown: {found} are compatible with these {unit}s"
    few = f"the interval, {found}, is approximate where few {unit}s differ"
    return f"no difference is shown: p decides, which is exact, and {few}"


def rounded(value: float) -> float:
    """Returns a score with the decimals of all scores."""
    # Adding 0 makes a negative zero positive.
    return round(float(value), _DECIMALS) + 0.0


def rounded_interval(interval: Interval) -> list[float] | None:
    """Returns an interval with the decimals of all scores."""
    return None if interval is None else [rounded(bound) for bound in interval]


def significant(p_value: float) -> float:
    """Returns a p-value with the digits of all p-values."""
    return float(f"{p_value:.{_DIGITS}g}")


def _conditions(pairs: Sequence[Pair]) -> list[str]:
    return [one.condition for one, _ in pairs]


def _tasks(result: EpisodeResult) -> int:
    return sum(step is not None for step in (result.asked or {}).values())


def _success_at_end(result: EpisodeResult) -> bool:
    assert result.success_at_end is not None
    return result.success_at_end


def _steps_to_success(result: EpisodeResult) -> int:
    assert result.steps_to_success is not None
    return result.steps_to_success


def _measure(name: str) -> Callable[[EpisodeResult], float]:
    return lambda result: result.measures[name]


def _completed(task: str) -> Callable[[EpisodeResult], bool]:
    return lambda result: (result.asked or {})[task] is not None

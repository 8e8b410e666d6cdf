"""Scores of two policies that played the same episodes, a row each, with what the text and the JSON show of it."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

from kitchen_suite.evaluation.paired import PairedVerdicts, holm, mean_difference
from kitchen_suite.evaluation.scores import EpisodeResult, Interval

Pair = tuple[EpisodeResult, EpisodeResult]
"""The results of two policies in the same episode."""

RATE = "%"
"""Unit of the scores that are rates, from 0 to 1 in JSON, and which text shows in hundredths."""

# Decimals of differences and rates, as of all scores, and significant digits of p-values.
_DECIMALS = 6
_DIGITS = 6


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
      verdicts: in how many episodes one policy alone reached it; None for means.
    """

    episodes: int
    a: float
    b: float
    difference: float
    interval: Interval
    unit: str = ""
    p_value: float | None = None
    verdicts: PairedVerdicts | None = None

    @classmethod
    def of_verdicts(cls, pairs: Sequence[Pair], verdict: Callable[[EpisodeResult], float]) -> "PairedScore":
        """Returns how often each policy reached what a function of the result is true for."""
        first = [bool(verdict(one)) for one, _ in pairs]
        second = [bool(verdict(other)) for _, other in pairs]
        counted = PairedVerdicts.of(first, second)
        return cls(
            episodes=len(pairs),
            a=sum(first) / len(pairs),
            b=sum(second) / len(pairs),
            difference=counted.difference,
            interval=counted.interval,
            unit=RATE,
            p_value=counted.p_value,
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
    ) -> "PairedScore":
        """Returns the means of a function of the result, whose differences are at most `greatest`."""
        difference, interval = mean_difference([value(one) - value(other) for one, other in pairs], greatest=greatest)
        return cls(
            episodes=len(pairs),
            a=sum(value(one) for one, _ in pairs) / len(pairs),
            b=sum(value(other) for _, other in pairs) / len(pairs),
            difference=difference,
            interval=interval,
            unit=unit,
        )

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
        return row


def paired_scores(pairs: Sequence[Pair]) -> dict[str, PairedScore]:
    """Returns the scores of some episodes by name, `success` first."""
    rows = {"success": PairedScore.of_verdicts(pairs, lambda result: result.success)}
    example, partner = pairs[0]
    if example.asked is None:
        rows["mean_progress"] = PairedScore.of_means(pairs, lambda result: result.progress)
    else:
        most = max(len(one.asked or {}) for one, _ in pairs)
        rows["mean_tasks"] = PairedScore.of_means(pairs, _tasks, greatest=float(most))
    # One of the two may measure more, such as its quality.
    common = {name: value for name, value in example.measures.items() if name in partner.measures}
    for name, value in common.items():
        of = PairedScore.of_verdicts if isinstance(value, bool) else PairedScore.of_means
        rows[name] = of(pairs, _measure(name))
    return rows


def paired_task_rates(pairs: Sequence[Pair]) -> dict[str, PairedScore]:
    """Returns how often each task was completed where it was asked."""
    by_task: dict[str, list[Pair]] = {}
    for one, other in pairs:
        for name in one.asked or {}:
            by_task.setdefault(name, []).append((one, other))
    return {name: PairedScore.of_verdicts(by_task[name], _completed(name)) for name in sorted(by_task)}


def adjusted(scores: Sequence[PairedScore]) -> list[float]:
    """Returns the p-values of scores that have some, adjusted by Holm's method for being several."""
    return [significant(value) for value in holm([score.p_value for score in scores if score.p_value is not None])]


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


def _tasks(result: EpisodeResult) -> int:
    return sum(step is not None for step in (result.asked or {}).values())


def _measure(name: str) -> Callable[[EpisodeResult], float]:
    return lambda result: result.measures[name]


def _completed(task: str) -> Callable[[EpisodeResult], bool]:
    return lambda result: (result.asked or {})[task] is not None

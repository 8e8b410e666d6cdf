"""Compares policies that played the same episodes, pair by pair."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from kitchen_suite import checks
from kitchen_suite.evaluation.paired import PairedVerdicts
from kitchen_suite.evaluation.paired_scores import (
    Pair,
    PairedScore,
    adjusted,
    conclusion,
    paired_scores,
    paired_task_rates,
)
from kitchen_suite.evaluation.protocols import EPISODE
from kitchen_suite.evaluation.sides import Side, Source, check_pairs, sides_of
from kitchen_suite.policies import PolicyRef

# Policies that can be compared at once: a pair of them has a row of its own.
_MAX_POLICIES = 100


@dataclasses.dataclass(frozen=True, kw_only=True)
class PairedComparison:
    """Two policies on the same episodes.

    Attributes:
      first: the policy whose wins are counted.
      second: the other policy.
      pairs: the results of both in each episode, by condition.
    """

    first: Side
    second: Side
    pairs: Mapping[str, list[Pair]]

    @property
    def all_pairs(self) -> list[Pair]:
        """The pairs of all conditions."""
        return [pair for each in self.pairs.values() for pair in each]

    @property
    def unit(self) -> str:
        """What counts as one observation: an episode, or a condition where these are a sample, such as a kitchen."""
        return self.first.unit

    @property
    def is_sample(self) -> bool:
        """Whether conditions are the unit."""
        return self.unit != EPISODE

    @functools.cached_property
    def scores(self) -> dict[str, PairedScore]:
        """The scores of all episodes by name, `success` first."""
        return paired_scores(self.all_pairs, by_condition=self.is_sample)

    @functools.cached_property
    def task_rates(self) -> dict[str, PairedScore]:
        """How often each task was completed where it was asked."""
        return paired_task_rates(self.all_pairs, by_condition=self.is_sample)

    @functools.cached_property
    def scores_by_condition(self) -> dict[str, dict[str, PairedScore]]:
        """The scores of each condition; empty where there is one."""
        return {name: paired_scores(each) for name, each in self.pairs.items()} if len(self.pairs) > 1 else {}

    @property
    def success(self) -> PairedVerdicts:
        """In how many episodes one policy alone succeeded."""
        verdicts = self.scores["success"].verdicts
        assert verdicts
        return verdicts

    @property
    def wins(self) -> int:
        """Number of episodes in which the first policy alone succeeded."""
        return self.success.wins

    @property
    def losses(self) -> int:
        """Number of episodes in which the second policy alone succeeded."""
        return self.success.losses

    @property
    def ties(self) -> int:
        """Number of episodes in which both succeeded or both failed."""
        return self.success.ties

    @property
    def p_value(self) -> float:
        """The exact p-value that both succeed equally often: of McNemar's test, or by permutation of a sample."""
        p_value = self.scores["success"].p_value
        assert p_value is not None
        return p_value

    @property
    def leading(self) -> PairedVerdicts:
        """In how many conditions one policy succeeds more often."""
        balances = [sum(int(one.success) - other.success for one, other in each) for each in self.pairs.values()]
        return PairedVerdicts.of([balance > 0 for balance in balances], [balance < 0 for balance in balances])

    @property
    def differing(self) -> list[Pair]:
        """The pairs of which one episode succeeded and the other did not, in order."""
        return [(one, other) for one, other in self.all_pairs if one.success != other.success]

    @property
    def circumstances(self) -> dict[str, Any]:
        """What both policies were compared on, as JSON represents it."""
        first = self.first
        seeds = [result.seed for each in first.results.values() for result in each]
        varied = {spec.variations for spec in first.specs.values()}
        return {
            "protocol": first.protocol,
            "domain_name": first.first.domain_name,
            "variations": varied.pop() if len(varied) == 1 else "variations by condition",
            "episodes": len(self.all_pairs),
            **({"unit": self.unit, "clusters": len(self.pairs)} if self.is_sample else {}),
            "seed": min(seeds),
            "versions": dict(first.first.versions),
        }

    @property
    def better(self) -> Literal["a", "b"] | None:
        """The policy that is shown to succeed more often, `a` or `b`; None where neither is.

        It is shown if p is below 0.05 and the interval of the difference excludes 0.
        """
        return self.scores["success"].greater

    @property
    def conclusion(self) -> str:
        """A sentence on which policy succeeds more often, if the episodes show that."""
        return conclusion(self.scores["success"], self.first.name, self.second.name, self.unit)

    def as_json(self) -> dict[str, Any]:
        """Returns all results as JSON represents them; those of success and tasks also at the top level."""
        scores = {name: score.as_json() for name, score in self.scores.items()}
        success = scores["success"]
        row = {
            "a": _policy(self.first),
            "b": _policy(self.second),
            **self.circumstances,
            **{name: success[name] for name in ("wins", "losses", "ties", "p_value")},
            **{f"{name}_difference": score["difference"] for name, score in scores.items()},
            "intervals": {f"{name}_difference": score["interval"] for name, score in scores.items()},
            "conclusion": self.conclusion,
            "scores": scores,
        }
        if tasks := self.task_rates:
            p_values = adjusted([*tasks.values()])
            row["task_rates"] = {
                name: {**rate.as_json(), "p_value_holm": p_value}
                for (name, rate), p_value in zip(tasks.items(), p_values, strict=True)
            }
        if conditions := self.scores_by_condition:
            row["conditions"] = {
                name: {score: each.as_json() for score, each in scores.items()} for name, scores in conditions.items()
            }
        row["differing"] = [
            {"condition": one.condition, "seed": one.seed, "succeeded": "a" if one.success else "b"}
            for one, _ in self.differing
        ]
        return row


def compare(a: Source, b: Source) -> PairedComparison:
    """Compares two policies on the same episodes.

    Args:
      a: the policy whose wins are counted: an `Evaluation`, a `Recording`, or the path of one, which is a receipt, the
        JSON of an evaluation with its episodes, or the folder of a recording.
      b: the other policy.

    Returns the comparison, in which a difference is the first policy's score less the second's.

    Raises:
      AlteredError: a file does not agree with itself.
      OSError: a file or folder cannot be read.
      ValueError: the episodes cannot be paired; the message names all that differs.
    """
    (comparison,) = compare_all([a, b])
    return comparison


def compare_all(sources: Sequence[Source]) -> list[PairedComparison]:
    """Compares each policy with each later one; arguments and exceptions are as in `compare`."""
    checks.integer(len(sources), "the number of policies", minimum=2, maximum=_MAX_POLICIES)
    played = sides_of(sources)
    # Before any statistics.
    for other in played[1:]:
        check_pairs(played[0], other)
    return [
        PairedComparison(first=first, second=second, pairs={name: _paired(first, second, name) for name in first.specs})
        for first, second in itertools.combinations(played, 2)
    ]


def adjusted_p_values(comparisons: Sequence[PairedComparison]) -> list[float]:
    """Returns the p-values of several comparisons, adjusted by Holm's method."""
    return adjusted([comparison.scores["success"] for comparison in comparisons])


def all_as_json(comparisons: Sequence[PairedComparison]) -> dict[str, Any]:
    """Returns the comparisons of more than two policies as JSON represents them."""
    rows = zip(comparisons, adjusted_p_values(comparisons), strict=True)
    return {
        **comparisons[0].circumstances,
        "comparisons": [{**comparison.as_json(), "p_value_holm": p_value} for comparison, p_value in rows],
    }


def _paired(first: Side, second: Side, condition: str) -> list[Pair]:
    by_seed = {result.seed: result for result in second.results[condition]}
    return [(result, by_seed[result.seed]) for result in first.results[condition]]


def _policy(played: Side) -> dict[str, Any]:
    return {"name": played.name, "policy": PolicyRef.parse(played.policy).without_file}

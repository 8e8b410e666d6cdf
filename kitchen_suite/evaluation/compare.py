"""Compares policies that played the same episodes, pair by pair."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from kitchen_suite import checks
from kitchen_suite.evaluation.paired import PairedVerdicts, holm
from kitchen_suite.evaluation.paired_scores import (
    Pair,
    PairedScore,
    conclusion,
    paired_scores,
    paired_task_rates,
    significant,
)
from kitchen_suite.evaluation.protocols import EPISODE
from kitchen_suite.evaluation.sides import Side, Source, check_across, check_pairs, circumstances, sides_of
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
      across: names of the arguments of the environments by which the episodes of both differ.
    """

    first: Side
    second: Side
    pairs: Mapping[str, list[Pair]]
    across: Sequence[str] = ()

    @property
    def all_pairs(self) -> list[Pair]:
        """The pairs of all conditions."""
        return [pair for each in self.pairs.values() for pair in each]

    @property
    def unit(self) -> str:
        """The unit of observation: an episode, or a condition where these are a sample, such as a kitchen."""
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
        """How often each task was completed where it was asked, with p-values adjusted for the number of tasks."""
        return paired_task_rates(self.all_pairs, by_condition=self.is_sample)

    @functools.cached_property
    def scores_by_condition(self) -> dict[str, dict[str, PairedScore]]:
        """The scores of each condition; empty where there is one."""
        return {name: paired_scores(each) for name, each in self.pairs.items()} if len(self.pairs) > 1 else {}

    @property
    def _verdicts(self) -> PairedVerdicts:
        """In how many episodes one policy alone succeeded."""
        verdicts = self.scores["success"].verdicts
        assert verdicts
        return verdicts

    @property
    def wins(self) -> int:
        """Number of episodes in which the first policy alone succeeded."""
        return self._verdicts.wins

    @property
    def losses(self) -> int:
        """Number of episodes in which the second policy alone succeeded."""
        return self._verdicts.losses

    @property
    def ties(self) -> int:
        """Number of episodes in which both succeeded or both failed."""
        return self._verdicts.ties

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
        """The episodes that both policies played, as JSON represents them."""
        return circumstances([self.first, self.second], self.across)

    @property
    def better(self) -> Literal["a", "b"] | None:
        """The policy that is shown to succeed more often, `a` or `b`; None where neither is.

        It is shown if p is below 0.05 and the interval of the difference excludes 0.
        """
        return self.scores["success"].greater

    @property
    def conclusion(self) -> str:
        """A sentence on which policy succeeds more often, if the episodes show that."""
        success = self.scores["success"]
        return conclusion(
            success.difference, success.interval, self.p_value, (self.first.name, self.second.name), self.unit
        )

    def as_json(self) -> dict[str, Any]:
        """Returns all results as JSON represents them; those of success and tasks also at the top level."""
        scores = {name: score.as_json() for name, score in self.scores.items()}
        success = scores["success"]
        row = {
            "a": self._policy(self.first),
            "b": self._policy(self.second),
            **self.circumstances,
            **{name: success[name] for name in ("wins", "losses", "ties", "p_value")},
            **{f"{name}_difference": score["difference"] for name, score in scores.items()},
            "intervals": {f"{name}_difference": score["interval"] for name, score in scores.items()},
            "conclusion": self.conclusion,
            "scores": scores,
        }
        if tasks := self.task_rates:
            row["task_rates"] = {name: rate.as_json() for name, rate in tasks.items()}
        if conditions := self.scores_by_condition:
            row["conditions"] = {
                name: {score: each.as_json() for score, each in scores.items()} for name, scores in conditions.items()
            }
        row["differing"] = [
            {"condition": one.condition, "seed": one.seed, "succeeded": "a" if one.success else "b"}
            for one, _ in self.differing
        ]
        return row

    def _policy(self, side: Side) -> dict[str, Any]:
        arguments = {"arguments": side.arguments(self.across)} if self.across else {}
        return {"name": side.name, "policy": PolicyRef.parse(side.policy).without_file, **arguments}


def compare(a: Source, b: Source, *, across: str | Sequence[str] = ()) -> PairedComparison:
    """Compares two policies on the same episodes.

    Args:
      a: the policy whose wins are counted: an `Evaluation`, a `Recording`, or the path of one, which is a receipt, the
        JSON of an evaluation with its episodes, or the folder of a recording.
      b: the other policy.
      across: names of arguments of the environments, such as `variations`, that may differ and must: episodes of the
        same seed are pairs, and their difference is what the arguments change. None by default.

    Returns the comparison, in which a difference is the first policy's score less the second's.

    Raises:
      AlteredError: a file does not agree with itself.
      OSError: a file or folder cannot be read.
      ValueError: the episodes cannot be paired; the message names all that differs. Or nothing differs in `across`.
    """
    (comparison,) = compare_all([a, b], across=across)
    return comparison


def compare_all(sources: Sequence[Source], *, across: str | Sequence[str] = ()) -> list[PairedComparison]:
    """Compares each policy with each later one; arguments and exceptions are as in `compare`."""
    checks.integer(len(sources), "the number of policies", minimum=2, maximum=_MAX_POLICIES)
    played = sides_of(sources)
    names = [*dict.fromkeys([across] if isinstance(across, str) else across)]
    check_across(played, names)
    # Before any statistics.
    differing = {name for other in played[1:] for name in check_pairs(played[0], other, names)}
    for name in names:
        if name not in differing:
            problem = f"nothing is compared across {name!r}, which differs in no pair of episodes"
            raise ValueError(f"{problem}: it is {checks.shown(played[0].arguments([name])[name])}")
    return [
        PairedComparison(
            first=first,
            second=second,
            pairs={name: _paired(first, second, name) for name in first.specs},
            across=names,
        )
        for first, second in itertools.combinations(played, 2)
    ]


def compared_sides(comparisons: Sequence[PairedComparison]) -> list[Side]:
    """Returns the policies of comparisons, each once, in order."""
    return [*{side.name: side for each in comparisons for side in (each.first, each.second)}.values()]


def adjusted_p_values(comparisons: Sequence[PairedComparison]) -> list[float]:
    """Returns the p-values of several comparisons, adjusted by Holm's method."""
    return [significant(value) for value in holm([comparison.p_value for comparison in comparisons])]


def all_as_json(comparisons: Sequence[PairedComparison]) -> dict[str, Any]:
    """Returns the comparisons of more than two policies as JSON represents them."""
    rows = zip(comparisons, adjusted_p_values(comparisons), strict=True)
    return {
        **circumstances(compared_sides(comparisons), comparisons[0].across),
        "comparisons": [{**comparison.as_json(), "p_value_holm": p_value} for comparison, p_value in rows],
    }


def _paired(first: Side, second: Side, condition: str) -> list[Pair]:
    by_seed = {result.seed: result for result in second.results[condition]}
    return [(result, by_seed[result.seed]) for result in first.results[condition]]

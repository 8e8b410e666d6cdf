"""Compares methods, each by several training seeds whose policies played the same episodes."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.evaluation.paired_scores import (
    EpisodeScore,
    conclusion,
    episode_scores,
    greater,
    rounded,
    rounded_interval,
    significant,
)
from kitchen_suite.evaluation.protocols import EPISODE
from kitchen_suite.evaluation.scores import EpisodeResult, Interval
from kitchen_suite.evaluation.sides import Side, Source, check_pairs, circumstances, sides_of
from kitchen_suite.evaluation.training_seeds import Estimate, method_difference, method_mean
from kitchen_suite.policies import PolicyRef

# Policies of a method that can be compared at once.
_MAX_SEEDS = 100

# What the names of training seeds end with, beside what they have in common.
_COUNTERS = "0123456789_-. (/"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Method:
    """A way to train policies, by those of several training seeds.

    Attributes:
      name: what the names of its policies have in common.
      seeds: the policies, with the results of their episodes.
    """

    name: str
    seeds: Sequence[Side]

    def values(self, of: Callable[[EpisodeResult], float]) -> NDArray[np.float64]:
        """Returns a score of the episodes of each training seed `(seeds, n)`; in kitchens that are a sample, its means.

        Episodes of all policies are in the same order.
        """
        rows = []
        for side in self.seeds:
            by_condition = [
                [float(of(result)) for result in sorted(results, key=lambda result: result.seed)]
                for results in side.results.values()
            ]
            is_sample = side.unit != EPISODE
            rows.append([*map(np.mean, by_condition)] if is_sample else [*itertools.chain(*by_condition)])
        return np.array(rows, np.float64)

    def as_json(self) -> dict[str, Any]:
        """Returns name and policies as JSON represents them."""
        policies = [
            {
                "name": side.name,
                "policy": PolicyRef.parse(side.policy).without_file,
                "success": rounded(side_success),
            }
            for side, side_success in zip(self.seeds, self.successes, strict=True)
        ]
        return {"name": self.name, "training_seeds": policies}

    @property
    def successes(self) -> list[float]:
        """Success rate of each training seed."""
        return [float(row.mean()) for row in self.values(lambda result: result.success)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class MethodScore:
    """A score of two methods.

    Attributes:
      a: mean of the first method.
      b: mean of the second method.
      difference: the first method's mean less the second's.
      unit: as of `PairedScore`.
    """

    a: Estimate
    b: Estimate
    difference: Estimate
    unit: str

    @classmethod
    def of(cls, first: Method, second: Method, score: EpisodeScore) -> "MethodScore":
        """Returns a score of two methods."""
        one, other = first.values(score.of), second.values(score.of)
        return cls(
            a=method_mean(one, low=score.low, high=score.high),
            b=method_mean(other, low=score.low, high=score.high),
            difference=method_difference(one, other, greatest=score.high - score.low),
            unit=score.unit,
        )

    def as_json(self) -> dict[str, Any]:
        """Returns the score as JSON represents it."""
        return {
            "a": rounded(self.a.value),
            "b": rounded(self.b.value),
            "difference": rounded(self.difference.value),
            "interval": rounded_interval(self.difference.interval),
            "intervals": {"a": rounded_interval(self.a.interval), "b": rounded_interval(self.b.interval)},
            "p_value": significant(self.difference.p_value),
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class MethodComparison:
    """Two methods on the same episodes.

    Attributes:
      first: the method from whose mean the other's is subtracted.
      second: the other method.
    """

    first: Method
    second: Method

    @property
    def sides(self) -> list[Side]:
        """The policies of both methods."""
        return [*self.first.seeds, *self.second.seeds]

    @functools.cached_property
    def scores(self) -> dict[str, MethodScore]:
        """The scores of both by name, `success` first."""
        found = episode_scores([[*itertools.chain(*side.results.values())] for side in self.sides])
        return {name: MethodScore.of(self.first, self.second, score) for name, score in found.items()}

    @property
    def difference(self) -> float:
        """The first method's success rate less the second's."""
        return self.scores["success"].difference.value

    @property
    def interval(self) -> Interval:
        """The 95 % interval of the difference, for other training seeds and other episodes."""
        return self.scores["success"].difference.interval

    @property
    def p_value(self) -> float:
        """The p-value that both methods succeed equally often."""
        return self.scores["success"].difference.p_value

    @property
    def better(self) -> Literal["a", "b"] | None:
        """The method that is shown to succeed more often, as `PairedComparison.better`."""
        return greater(self.difference, self.interval, self.p_value)

    @property
    def conclusion(self) -> str:
        """A sentence on which method succeeds more often, if the training seeds show that."""
        names = self.first.name, self.second.name
        return conclusion(self.difference, self.interval, self.p_value, names, "training seed")

    @property
    def circumstances(self) -> dict[str, Any]:
        """The episodes that both methods played, as JSON represents them."""
        return circumstances(self.sides)

    def as_json(self) -> dict[str, Any]:
        """Returns all results as JSON represents them; those of success also at the top level."""
        scores = {name: score.as_json() for name, score in self.scores.items()}
        return {
            "a": self.first.as_json(),
            "b": self.second.as_json(),
            **self.circumstances,
            "num_seeds": {"a": len(self.first.seeds), "b": len(self.second.seeds)},
            "p_value": scores["success"]["p_value"],
            **{f"{name}_difference": score["difference"] for name, score in scores.items()},
            "intervals": {f"{name}_difference": score["interval"] for name, score in scores.items()},
            "conclusion": self.conclusion,
            "scores": scores,
        }


def compare_methods(a: Sequence[Source], b: Sequence[Source]) -> MethodComparison:
    """Compares two methods by policies of several training seeds.

    The interval of the difference contains what other training seeds and other episodes could have shown.

    Args:
      a: evaluations of the first method, one of each training seed, as those of `kitchen_suite.compare`; at least two.
      b: evaluations of the second method, as many or not, under the same protocol and of the same episodes.

    Returns the comparison, in which a difference is the first method's mean less the second's.

    Raises:
      AlteredError: a file does not agree with itself.
      OSError: a file or folder cannot be read.
      ValueError: a method has one training seed, or the episodes are not the same; the message names what differs.
    """
    for name, sources in (("a", a), ("b", b)):
        _check_seeds(name, sources)
    sides = sides_of([*a, *b])
    for other in sides[1:]:
        check_pairs(sides[0], other)
    if sum(len(results) for results in sides[0].results.values()) < 2:
        raise ValueError("a comparison of methods needs at least two episodes")
    first, second = sides[: len(a)], sides[len(a) :]
    for seeds in (first, second):
        _check_copies(seeds)
    names = _name_of(first), _name_of(second)
    # Without names that say which is which.
    first_name, second_name = names if all(names) and names[0] != names[1] else ("A", "B")
    return MethodComparison(
        first=Method(name=first_name, seeds=first),
        second=Method(name=second_name, seeds=second),
    )


def _check_seeds(name: str, sources: Sequence[Source]) -> None:
    """Raises an error unless there are several sources, each once."""
    if isinstance(sources, str | Path) or not isinstance(sources, Sequence):
        raise TypeError(f"{name} must be a list of evaluations, one of each training seed, got {checks.shown(sources)}")
    checks.integer(len(sources), f"the number of training seeds of {name}", minimum=0, maximum=_MAX_SEEDS)
    if len(sources) < 2:
        reason = "how much a method's policies differ from seed to seed is unknown with fewer"
        raise ValueError(f"a comparison of methods needs at least two training seeds of {name}: {reason}")
    paths = [Path(each).resolve() if isinstance(each, str | Path) else id(each) for each in sources]
    for place, path in enumerate(paths):
        if path in paths[:place]:
            raise ValueError(f"{checks.shown(str(sources[place]))} is given twice as a training seed of {name}")


def _check_copies(seeds: Sequence[Side]) -> None:
    """Raises a ValueError if two training seeds are the same file of a policy with the same results."""
    for one, other in itertools.combinations(seeds, 2):
        digests = [[spec.policy_sha256 for spec in side.specs.values()] for side in (one, other)]
        if digests[0] == digests[1] and None not in digests[0] and one.results == other.results:
            raise ValueError(f"{one.name} and {other.name} are the same policy, and no two training seeds")


def _name_of(seeds: Sequence[Side]) -> str:
    """Returns what the names of training seeds have in common; empty if that is nothing."""
    places = zip(*(side.name for side in seeds), strict=False)
    common = itertools.takewhile(lambda letters: len({*letters}) == 1, places)
    return "".join(letters[0] for letters in common).rstrip(_COUNTERS)

"""Checks of episodes: they are played again from their actions, without the policy, and compared."""

import collections
import contextlib
import dataclasses
from collections.abc import Generator, Iterable, Mapping, Sequence
from typing import Any, Generic, TypeVar

from kitchen_suite.episodes.replay import ReplayedEpisode, Verdict, worst
from kitchen_suite.episodes.spec import even_count
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.rollout import play_condition
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.traces import ActionReplay, Trace
from kitchen_suite.gymnasium_env.observations import OF_PICTURES


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayedResult:
    """The results of an episode of an evaluation and of its replay, and their differences.

    Attributes:
      recorded: the result that was kept.
      replayed: that of the replay; without what the recorded one does not say, as one of version 1.0.
      first: first control step at which numbers differ, 0 for the reset; None if they are equal to the bit.
      greatest: greatest difference of the numbers after the last control steps.
    """

    recorded: EpisodeResult
    replayed: EpisodeResult
    first: int | None
    greatest: float

    @property
    def condition(self) -> str:
        """Name of the episode's condition."""
        return self.recorded.condition

    @property
    def episode(self) -> int:
        """Number of the episode in its condition."""
        return self.recorded.episode

    @property
    def seed(self) -> int:
        """Seed of the episode."""
        return self.recorded.seed

    @property
    def verdict(self) -> Verdict:
        """`equal`, `other digits` or `altered`."""
        if not self.scores_alike:
            return "altered"
        return "equal" if self.first is None else "other digits"

    @property
    def scores_alike(self) -> bool:
        """Whether both have the same result, in numbers of the same types."""
        return repr(self.recorded) == repr(self.replayed)

    @property
    def differences(self) -> tuple[str, ...]:
        """Descriptions of the differences: of the numbers, and of each entry of the result; empty if there are none."""
        numbers = [] if self.first is None else [f"numbers differ from control step {self.first} on"]
        names = [field.name for field in dataclasses.fields(EpisodeResult)]
        pairs = {name: (getattr(self.recorded, name), getattr(self.replayed, name)) for name in names}
        return (*numbers, *(f"{name} {one}, replayed {other}" for name, (one, other) in pairs.items() if one != other))


E = TypeVar("E", ReplayedResult, ReplayedEpisode)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Check(Generic[E]):
    """The result of playing episodes again.

    Attributes:
      episodes: of each episode the comparison with its replay, in order, with a `verdict`, a `seed` and `differences`.
      scores: of the replayed episodes, as in `Evaluation.scores`.
    """

    episodes: Sequence[E]
    scores: Mapping[str, Any]

    @property
    def verdict(self) -> Verdict:
        """The verdict on all episodes.

        `equal` if all numbers are equal to the bit, `other digits` if all results are, but not all numbers, and
        `altered` if results differ: episodes were altered, or another machine rounds otherwise.
        """
        return worst(episode.verdict for episode in self.episodes)

    @property
    def differing(self) -> list[E]:
        """The episodes that are not equal to the bit, first those with other results."""
        differing = [episode for episode in self.episodes if episode.verdict != "equal"]
        return sorted(differing, key=lambda episode: episode.verdict != "altered")


def replayed_results(
    plan: EvaluationPlan,
    results: Mapping[str, Sequence[EpisodeResult]],
    traces: Mapping[str, Sequence[Trace]],
    num_envs: int,
    num_threads: int | None,
) -> Generator[ReplayedResult, None, None]:
    """Plays the actions of the episodes of all conditions again, and yields each comparison as its episode ends.

    Raises a ValueError if actions do not fit the environments.
    """
    plan = dataclasses.replace(plan, specs={name: spec.without(OF_PICTURES) for name, spec in plan.specs.items()})
    for name, spec in plan.specs.items():
        recorded, given = results[name], traces[name]
        waiting = collections.deque((result.episode, result.seed) for result in recorded)
        # An episode that goes on after its last action differs, and need not be played to its end.
        longest = max(len(trace.actions) for trace in given)
        limited = dataclasses.replace(spec, max_episode_steps=min(spec.max_episode_steps, longest + 1))
        count = even_count(len(recorded), num_envs)
        with contextlib.closing(limited.make_vector_env(count, num_threads)) as environments:
            shape = environments.single_action_space.shape
            if wrong := next((trace.actions.shape[1:] for trace in given if trace.actions.shape[1:] != shape), None):
                raise ValueError(f"{name} has actions of shape {wrong}, not {shape}: the receipt was altered")
            replay = ActionReplay({result.seed: trace.actions for result, trace in zip(recorded, given, strict=True)})
            for replayed, trace, _ in play_condition(name, plan, environments, replay, waiting):
                first = given[replayed.episode].first_difference(trace)
                yield ReplayedResult(
                    recorded=recorded[replayed.episode],
                    replayed=replayed.with_fields_of(recorded[replayed.episode]),
                    first=first,
                    greatest=0.0 if first is None else given[replayed.episode].greatest_difference(trace),
                )


def check_of(plan: EvaluationPlan, episodes: Iterable[ReplayedResult]) -> Check[ReplayedResult]:
    """Returns the check of all episodes of a plan, given in any order."""
    by_condition: dict[str, list[ReplayedResult]] = {name: [] for name in plan.specs}
    for episode in episodes:
        by_condition[episode.condition].append(episode)
    for each in by_condition.values():
        each.sort(key=lambda episode: episode.episode)
    scores = {name: plan.scores([episode.replayed for episode in each]) for name, each in by_condition.items()}
    in_order = [episode for each in by_condition.values() for episode in each]
    return Check(episodes=in_order, scores=plan.main_scores(scores))

"""The sides of a comparison: policies with the results of their episodes, which are checked to be pairs."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from kitchen_suite import checks, suite
from kitchen_suite.episodes.recording import SPEC_FILE, Recording
from kitchen_suite.episodes.replay import reset_options
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.protocols import EPISODE
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import OF_OBSERVATIONS
from kitchen_suite.tasks.task import SuiteTask

Source = str | Path | Evaluation | Recording
"""An evaluation or a recording, or the path of one: a receipt, JSON with episodes, or the folder of a recording."""

Recorded = Callable[[SuiteTask, EpisodeResult], tuple[dict[str, Any] | None, NDArray]]
"""Returns the options of the reset of an episode of a task, and its actions `(T, k)`."""

# The argument of the environments that is no argument of their task.
_LENGTH = "max_episode_steps"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Side:
    """One of the policies that are compared.

    Attributes:
      name: of the policy, for readers.
      policy: the policy's own name.
      protocol: under which it was evaluated; None for a recording.
      unit: what counts as one observation, see `EvaluationPlan.unit`.
      specs: specification of the episodes of each condition.
      results: results of the episodes of each condition, in order.
      recorded: by which episodes can be played again; None where the actions were not kept.
      is_read: whether the episodes were read from a file or a folder, which may have been altered.
    """

    name: str
    policy: str
    protocol: str | None
    unit: str
    specs: Mapping[str, EpisodeSpec]
    results: Mapping[str, Sequence[EpisodeResult]]
    recorded: Recorded | None
    is_read: bool

    @property
    def first(self) -> EpisodeSpec:
        """Specification of the first condition."""
        return next(iter(self.specs.values()))

    def arguments(self, names: Sequence[str]) -> dict[str, Any]:
        """Returns the values of some arguments of the environments, as JSON represents them; None for a default."""
        return {name: self.first.max_episode_steps if name == _LENGTH else self.first.argument(name) for name in names}


def circumstances(sides: Sequence[Side], across: Sequence[str] = ()) -> dict[str, Any]:
    """Returns what sides are compared on, as JSON represents it; they differ in the arguments `across` alone."""
    example = sides[0]
    varied = [*dict.fromkeys(spec.variations for each in sides for spec in each.specs.values())]
    is_by_condition = len({spec.variations for spec in example.specs.values()}) > 1
    results = [result for each in example.results.values() for result in each]
    return {
        "protocol": example.protocol,
        "domain_name": example.first.domain_name,
        "variations": "variations by condition" if is_by_condition else " and ".join(varied),
        **({"across": [*across]} if across else {}),
        "episodes": len(results),
        **({"unit": example.unit, "clusters": len(example.specs)} if example.unit != EPISODE else {}),
        "seed": min(result.seed for result in results),
        "versions": dict(example.first.versions),
    }


def sides_of(sources: Sequence[Source]) -> list[Side]:
    """Returns the policies and the episodes of sources; a ValueError if one has none that can be paired."""
    return _named([*map(_side, sources)], sources)


def _side(source: Source) -> Side:
    """Returns the policy and the episodes of a source; a ValueError if it has none that can be paired."""
    if isinstance(source, str | Path):
        path = Path(source)
        if not path.exists():
            raise FileNotFoundError(f"there is no evaluation or recording {str(source)!r}")
        source = Recording.open(path) if (path / SPEC_FILE).is_file() else Evaluation.read(path)
    return _evaluated(source) if isinstance(source, Evaluation) else _recorded(source)


def _evaluated(evaluation: Evaluation) -> Side:
    def recorded(task: SuiteTask, result: EpisodeResult) -> tuple[dict[str, Any] | None, NDArray]:
        return result.reset or None, evaluation.traces[result.condition][result.episode].actions

    plan = evaluation.plan
    return Side(
        name=evaluation.name,
        policy=plan.first.policy,
        protocol=plan.protocol,
        unit=plan.unit,
        specs=plan.specs,
        results=evaluation.results,
        recorded=recorded if evaluation.traces else None,
        is_read=evaluation.path is not None,
    )


def _recorded(recording: Recording) -> Side:
    def recorded(task: SuiteTask, result: EpisodeResult) -> tuple[dict[str, Any] | None, NDArray]:
        episode = recording.load(result.episode)
        return reset_options(task, episode), episode.arrays["action"]

    spec = recording.spec
    if spec.origin is not None:
        raise ValueError(f"{recording.folder} holds episodes of another program, without seeds to pair them by")
    if not recording.indices:
        raise ValueError(f"{recording.folder} holds no episodes")
    name = spec.task_name
    with contextlib.closing(spec.without(OF_OBSERVATIONS).make_environment()) as environment:
        task = suite_env(environment).composer_task
        results = [
            EpisodeResult.of(
                task,
                episode.last_info,
                condition=name,
                episode=episode.index,
                seed=spec.seed + episode.index,
                control_steps=episode.steps,
            )
            for episode in recording
        ]
    return Side(
        name=recording.folder.resolve().name,
        policy=spec.policy,
        protocol=None,
        unit=EPISODE,
        specs={name: spec},
        results={name: results},
        recorded=recorded,
        is_read=True,
    )


def check_pairs(first: Side, second: Side, across: Collection[str] = ()) -> set[str]:
    """Raises a ValueError that names all that differs, unless each episode has a partner of the same circumstances.

    What policies observe may differ, and the kind of processor: neither changes where an episode starts. So may whether
    quality is measured, which changes no number of an episode, and the arguments `across`; returns which do.
    """
    found = [*dict.fromkeys(_differences(first, second))]
    if others := [each for each in found if each.argument not in across]:
        problem = f"{first.name} and {second.name} cannot be compared: {'; '.join(each.text for each in others)}"
        if all(each.argument for each in others):
            names = ",".join(dict.fromkeys(each.argument for each in found))
            problem = f"{problem}. If that is to be compared, pair the same seeds across it: --across={names}"
        raise ValueError(problem)
    return {each.argument for each in found}


def check_across(sides: Sequence[Side], across: Sequence[str]) -> None:
    """Raises a ValueError unless the names are those of arguments of the environments, by which episodes may differ."""
    spec = sides[0].first
    arguments = suite.find_domain(spec.domain_name).arguments(spec.env_class)
    for name in across:
        checks.choice(name, {*arguments, _LENGTH}, "argument across which policies are compared,")


class Difference(NamedTuple):
    """A difference of two sides by which they are no pairs.

    Attributes:
      text: what differs, for a message.
      argument: name of the argument of the environments that differs; empty for anything else.
    """

    text: str
    argument: str = ""


def _differences(first: Side, second: Side) -> Iterator[Difference]:
    if first.protocol != second.protocol:
        one, other = (each.protocol or "a recording, without a protocol" for each in (first, second))
        yield Difference(f"protocol {one}, and {other}")
    if first.first.domain_name != second.first.domain_name:
        yield Difference(f"domain_name {first.first.domain_name!r}, and {second.first.domain_name!r}")
        return
    if [*first.specs] != [*second.specs]:
        yield Difference(f"conditions {checks.shown([*first.specs])}, and {checks.shown([*second.specs])}")
        return
    for name, spec in first.specs.items():
        mine = _determinants(spec, second.specs[name])
        its = _determinants(second.specs[name], spec)
        arguments = {_LENGTH, *spec.task_kwargs, *second.specs[name].task_kwargs}
        for what in mine:
            if mine[what] != its[what]:
                text = f"{what} {checks.shown(mine[what])}, and {checks.shown(its[what])}"
                yield Difference(text, what if what in arguments else "")
    for name in first.specs:
        yield from map(Difference, _different_episodes(first, second, name))


def _determinants(spec: EpisodeSpec, other: EpisodeSpec) -> dict[str, Any]:
    """Returns what determines an episode beside its seed and the policy, by the names that another one has as well."""
    given = spec.without(OF_OBSERVATIONS).task_kwargs.keys() | other.without(OF_OBSERVATIONS).task_kwargs.keys()
    arguments = given - {"quality"}
    versions = {**dict.fromkeys(other.versions), **spec.versions}
    return {
        "task_name": spec.task_name,
        _LENGTH: spec.max_episode_steps,
        "seeding": spec.seeding,
        **{name: spec.argument(name) for name in sorted(arguments)},
        **{f"version of {name}": versions[name] for name in sorted(versions)},
    }


def _different_episodes(first: Side, second: Side, name: str) -> Iterator[str]:
    """Yields which seeds of a condition one of two alone has, and which ask for something else."""
    one = {result.seed: result for result in first.results[name]}
    other = {result.seed: result for result in second.results[name]}
    for mine, its, owner in ((one, other, first.name), (other, one, second.name)):
        if alone := sorted(mine.keys() - its.keys()):
            yield f"seeds {checks.shown(alone)} in {owner} alone"
    common = one.keys() & other.keys()
    if odd := sorted(seed for seed in common if _requests(one[seed]) != _requests(other[seed])):
        yield f"goals of the episodes of seeds {checks.shown(odd)}"


def _requests(result: EpisodeResult) -> tuple[dict[str, Any], set[str] | None]:
    return result.reset, None if result.asked is None else {*result.asked}


def _named(played: Sequence[Side], sources: Sequence[Source]) -> list[Side]:
    """Returns the policies with their paths for names, or with their places, where several have the same name."""
    names = [each.name for each in played]
    renamed = []
    for place, (each, source) in enumerate(zip(played, sources, strict=True), start=1):
        if names.count(each.name) == 1:
            renamed.append(each)
        elif isinstance(source, str | Path):
            renamed.append(dataclasses.replace(each, name=str(source)))
        else:
            renamed.append(dataclasses.replace(each, name=f"{each.name} ({place})"))
    return renamed

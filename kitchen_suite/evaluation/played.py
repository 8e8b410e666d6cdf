"""Episodes that a policy played, read from an evaluation or a recording, to be paired with those of another policy."""

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.episodes.recording import SPEC_FILE, Recording
from kitchen_suite.episodes.replay import reset_options
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.evaluation.evaluate import Evaluation
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.receipts import Receipt
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.verify import checked_plan, without_observations
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.task import SuiteTask


class RecordedActions(Protocol):
    """Actions from which episodes can be played again."""

    def actions(self, condition: str, index: int) -> NDArray:
        """Returns the actions `(T, k)` of an episode."""

    def reset_options(self, task: SuiteTask, condition: str, index: int) -> dict[str, Any] | None:
        """Returns the options of the reset of an episode of a task; None if there are none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlayedEpisodes:
    """The episodes of a policy by condition.

    Attributes:
      name: of the policy, for readers.
      policy: the policy's own name.
      protocol: under which it was evaluated; None for a recording.
      specs: specification of the episodes of each condition.
      results: results of the episodes of each condition, in order.
      recorded: the actions; None where they were not kept.
    """

    name: str
    policy: str
    protocol: str | None
    specs: Mapping[str, EpisodeSpec]
    results: Mapping[str, Sequence[EpisodeResult]]
    recorded: RecordedActions | None = None

    @property
    def first(self) -> EpisodeSpec:
        """Specification of the first condition."""
        return next(iter(self.specs.values()))


def read(source: str | Path | Evaluation) -> PlayedEpisodes:
    """Reads the episodes of a receipt, of the JSON of an evaluation with its episodes, or of a recording's folder.

    Raises an OSError if there is none, or it cannot be read, a ValueError if it has no episodes that can be paired.
    """
    if isinstance(source, Evaluation):
        return _evaluated(source.plan, source.results, name=PolicyRef.parse(source.plan.first.policy).without_file)
    path = Path(source)
    if not path.exists():
        raise FileNotFoundError(f"there is no evaluation or recording {str(source)!r}")
    if path.is_dir():
        return _read_recording(path)
    if path.match("episode_*.npz") and (path.parent / SPEC_FILE).is_file():
        raise ValueError(f"{path} is an episode of a recording: name its folder, {path.parent}")
    return _read_json(path) if path.suffix == ".json" else _read_receipt(path)


def _evaluated(
    plan: EvaluationPlan,
    results: Mapping[str, Sequence[EpisodeResult]],
    *,
    name: str,
    recorded: RecordedActions | None = None,
) -> PlayedEpisodes:
    return PlayedEpisodes(
        name=name,
        policy=plan.first.policy,
        protocol=plan.protocol,
        specs=plan.specs,
        results=results,
        recorded=recorded,
    )


class _ReceiptActions:
    """The actions of a receipt."""

    def __init__(self, receipt: Receipt) -> None:
        self._receipt = receipt

    def actions(self, condition: str, index: int) -> NDArray:
        return self._receipt.traces[condition][index].actions

    def reset_options(self, task: SuiteTask, condition: str, index: int) -> dict[str, Any] | None:
        return self._receipt.results[condition][index].reset or None


def _read_receipt(path: Path) -> PlayedEpisodes:
    receipt = Receipt.read(path)
    try:
        plan = checked_plan(receipt)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
    return _evaluated(plan, receipt.results, name=path.stem, recorded=_ReceiptActions(receipt))


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Rows:
    """Episodes in the JSON of an evaluation."""

    episodes: dict[str, list[EpisodeResult]]


def _read_json(path: Path) -> PlayedEpisodes:
    record = files.load_json(path, "the results of an evaluation")
    if not (isinstance(record, dict) and "protocol" in record):
        raise ValueError(f"{path} does not hold the results of an evaluation")
    if "episodes" not in record:
        raise ValueError(f"{path} holds scores without episodes: evaluate with --json and --episodes, or a receipt")
    results = files.parse(record, _Rows, f"{path} does not hold the episodes of an evaluation").episodes
    resets = {name: [result.reset for result in each] for name, each in results.items()}
    try:
        plan = EvaluationPlan.of(record, {name: each for name, each in resets.items() if any(each)})
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
    counts = {name: len(each) for name, each in results.items()}
    if counts != dict.fromkeys(plan.specs, plan.num_episodes):
        raise ValueError(f"{path} has not all episodes of its evaluation")
    return _evaluated(plan, results, name=path.stem)


class _RecordingActions:
    """The actions of a recording."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def actions(self, condition: str, index: int) -> NDArray:
        return self._recording.load(index).arrays["action"]

    def reset_options(self, task: SuiteTask, condition: str, index: int) -> dict[str, Any] | None:
        return reset_options(task, self._recording.load(index))


def _read_recording(folder: Path) -> PlayedEpisodes:
    if (folder / DESCRIPTION_FILE).is_file():
        flags = f"--output={folder} --resume --episodes --json=FILE"
        raise ValueError(f"{folder} is the folder of an evaluation: write a file, by kitchen-evaluate with {flags}")
    if not (folder / SPEC_FILE).is_file():
        raise ValueError(f"{folder} holds no recording, which has a file {SPEC_FILE}")
    recording = Recording.open(folder)
    spec = recording.spec
    if spec.origin is not None:
        raise ValueError(f"{folder} holds episodes of another program, without seeds to pair them by")
    if not recording.indices:
        raise ValueError(f"{folder} holds no episodes")
    name = spec.task_name
    with contextlib.closing(without_observations(spec).make_environment()) as environment:
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
    return PlayedEpisodes(
        name=folder.resolve().name,
        policy=spec.policy,
        protocol=None,
        specs={name: spec},
        results={name: results},
        recorded=_RecordingActions(recording),
    )


def check_pairs(first: PlayedEpisodes, second: PlayedEpisodes) -> None:
    """Raises a ValueError that names all that differs, unless each episode has a partner of the same circumstances.

    What policies observe may differ, and the kind of processor: neither changes where an episode starts. So may whether
    quality is measured, which changes no number of an episode.
    """
    if differing := [*dict.fromkeys(_differences(first, second))]:
        raise ValueError(f"{first.name} and {second.name} cannot be compared: {'; '.join(differing)}")


def _differences(first: PlayedEpisodes, second: PlayedEpisodes) -> Iterator[str]:
    if first.protocol != second.protocol:
        one, other = (each.protocol or "a recording, without a protocol" for each in (first, second))
        yield f"protocol {one}, and {other}"
    if first.first.domain_name != second.first.domain_name:
        yield f"domain_name {first.first.domain_name!r}, and {second.first.domain_name!r}"
        return
    if [*first.specs] != [*second.specs]:
        yield f"conditions {checks.shown([*first.specs])}, and {checks.shown([*second.specs])}"
        return
    for name, spec in first.specs.items():
        mine = _circumstances(spec, second.specs[name])
        its = _circumstances(second.specs[name], spec)
        for what in mine:
            if mine[what] != its[what]:
                yield f"{what} {checks.shown(mine[what])}, and {checks.shown(its[what])}"
    for name in first.specs:
        yield from _different_episodes(first, second, name)


def _circumstances(spec: EpisodeSpec, other: EpisodeSpec) -> dict[str, Any]:
    """Returns what determines an episode beside its seed and the policy, by the names that another one has as well."""
    given = without_observations(spec).task_kwargs.keys() | without_observations(other).task_kwargs.keys()
    arguments = given - {"quality"}
    versions = {**dict.fromkeys(other.versions), **spec.versions}
    return {
        "task_name": spec.task_name,
        "max_episode_steps": spec.max_episode_steps,
        "seeding": spec.seeding,
        **{name: spec.argument(name) for name in sorted(arguments)},
        **{f"version of {name}": versions[name] for name in sorted(versions)},
    }


def _different_episodes(first: PlayedEpisodes, second: PlayedEpisodes, name: str) -> Iterator[str]:
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

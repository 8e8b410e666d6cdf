"""Plays the episodes of a receipt again, without the policy, and computes their scores anew."""

import collections
import contextlib
import dataclasses
import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kitchen_suite import checks, files
from kitchen_suite.episodes.replay import Verdict, worst
from kitchen_suite.episodes.report import EpisodeBar, print_line, table
from kitchen_suite.episodes.spec import EpisodeSpec, even_count
from kitchen_suite.evaluation import tables
from kitchen_suite.evaluation.confirmed import constant_successes, format_subject
from kitchen_suite.evaluation.evaluate import as_json, play_condition
from kitchen_suite.evaluation.plan import EvaluationPlan, resets_of
from kitchen_suite.evaluation.receipts import ActionReplay, Receipt, Trace
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.gymnasium_env.observations import OF_PICTURES
from kitchen_suite.versions import MACHINE, machine

_VERDICTS = {
    Verdict.EQUAL: "the receipt holds: all numbers are equal to the bit, and all scores follow from them",
    Verdict.DIGITS_DIFFER: "the scores hold, but not all digits: actions were altered, or this is another machine",
    Verdict.ALTERED: "the scores are not those of the replay: the receipt was altered, or this is another machine",
}

# All on which nothing of an episode but its observations depends.
_OF_OBSERVATIONS = {*OF_PICTURES, "extra_observables", "goal_format"}

_MAX_LINES = 10  # Episodes that differ of which the report has a line.


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayedResult:
    """The results of an episode and of its replay, and their differences.

    Attributes:
      first: first control step at which numbers differ, 0 for the reset; None if they are equal to the bit.
      greatest: greatest difference of the numbers after the last control steps.
    """

    recorded: EpisodeResult
    replayed: EpisodeResult
    first: int | None
    greatest: float

    @property
    def verdict(self) -> Verdict:
        if not self.scores_alike:
            return Verdict.ALTERED
        return Verdict.EQUAL if self.first is None else Verdict.DIGITS_DIFFER

    @property
    def scores_alike(self) -> bool:
        """Whether both have the same result, in numbers of the same types."""
        return repr(self.recorded) == repr(self.replayed)

    def __str__(self) -> str:
        one, other = self.recorded, self.replayed
        names = [field.name for field in dataclasses.fields(one) if field.name != "trace"]
        differing = {name: (getattr(one, name), getattr(other, name)) for name in names}
        results = [f"{name} {a}, replayed {b}" for name, (a, b) in differing.items() if a != b]
        where = f"{one.condition}, episode {one.episode}, seed {one.seed}"
        start = "numbers are equal" if self.first is None else f"numbers differ from control step {self.first} on"
        return "; ".join([f"{where}: {start}", *results])


class AlteredError(checks.WorkFailedError):
    """A receipt that does not agree with itself."""


def verify(
    path: Path,
    *,
    published: Path | None = None,
    dataset: Path | None = None,
    num_envs: int = 16,
    num_threads: int | None = None,
    verbose: bool = False,
) -> Verdict:
    """Checks a receipt against itself, and plays its episodes again.

    Args:
      path: of the receipt.
      published: file of a result, as `kitchen-evaluate` writes it as JSON, which the receipt's has to be.
      dataset: folder of the recording from which the goals of the episodes were taken, where they were taken from one.
      num_envs: number of environments that are stepped together.
      num_threads: number of threads that step them; one per processor when None.
      verbose: whether to print what was found.

    Raises:
      AlteredError: what the receipt says does not agree with the rest of it, or with the published result.
      OSError: the file cannot be read, or is no receipt.
    """
    checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
    if num_threads is not None:
        checks.integer(num_threads, "num_threads", minimum=1, maximum=checks.MAX_THREADS)
    receipt = Receipt.read(path)
    try:
        plan = checked_plan(receipt)
        if published is not None:
            _check_published(receipt, published)
        if dataset is not None:
            _check_goals(plan, dataset)
        if verbose:
            subject = format_subject(plan, _caveats(receipt, dataset))
            print_line("\n".join([subject, tables.format_heading(plan), *_circumstances(receipt, plan)]))
            if published is not None:
                print_line(f"the published result {published} is that of the receipt")
        compared: dict[str, list[ReplayedResult]] = {name: [] for name in plan.specs}
        with EpisodeBar(plan.num_episodes * len(plan.specs)) as bar:
            for comparison in compare(receipt, plan, num_envs, num_threads):
                compared[comparison.recorded.condition].append(comparison)
                bar.count(comparison.replayed.success)
    except (TypeError, ValueError) as error:
        raise AlteredError(str(error)) from error
    everything = [comparison for each in compared.values() for comparison in each]
    verdict = worst(comparison.verdict for comparison in everything)
    if verbose:
        replayed = {
            name: sorted((one.replayed for one in each), key=lambda result: result.episode)
            for name, each in compared.items()
        }
        scores = {name: plan.scores(each) for name, each in replayed.items()}
        if plan.is_sample:
            print_line(f"\n{tables.format_sample(plan.main_scores(scores), replayed)}")
        else:
            for name, each in scores.items():
                print_line(f"\n{tables.format_scores(name, plan.specs[name].task_name, plan.num_episodes, each)}")
        print_line(f"\n{_table(compared)}\n")
        _print_differences(everything)
        print_line(_VERDICTS[verdict])
    return verdict


def compare(receipt: Receipt, plan: EvaluationPlan, num_envs: int, num_threads: int | None) -> Iterator[ReplayedResult]:
    """Plays the episodes of a receipt again, by its `checked_plan`, and yields each as it ends."""
    plan = dataclasses.replace(plan, specs={name: _without_pictures(spec) for name, spec in plan.specs.items()})
    for name, spec in plan.specs.items():
        results, traces = receipt.results[name], receipt.traces[name]
        waiting = collections.deque((result.episode, result.seed) for result in results)
        # An episode that goes on after its last action differs, and need not be played to its end.
        longest = max(len(trace.actions) for trace in traces)
        limited = dataclasses.replace(spec, max_episode_steps=min(spec.max_episode_steps, longest + 1))
        count = even_count(len(results), num_envs)
        with contextlib.closing(limited.make_vector_env(count, num_threads)) as environments:
            shape = environments.single_action_space.shape
            if wrong := next((trace.actions.shape[1:] for trace in traces if trace.actions.shape[1:] != shape), None):
                raise ValueError(f"{name} has actions of shape {wrong}, not {shape}: the receipt was altered")
            replay = ActionReplay({result.seed: trace.actions for result, trace in zip(results, traces, strict=True)})
            for replayed, trace in play_condition(name, plan, environments, replay, waiting, recorded=True):
                assert trace
                recorded, given = results[replayed.episode], traces[replayed.episode]
                first = given.first_difference(trace)
                greatest = 0.0 if first is None else given.greatest_difference(trace)
                yield ReplayedResult(recorded=recorded, replayed=replayed, first=first, greatest=greatest)


def _without_pictures(spec: EpisodeSpec) -> EpisodeSpec:
    return _without(spec, OF_PICTURES)


def without_observations(spec: EpisodeSpec) -> EpisodeSpec:
    """Returns a specification without the arguments that change what is observed, and nothing else of an episode."""
    return _without(spec, _OF_OBSERVATIONS)


def _without(spec: EpisodeSpec, arguments: Collection[str]) -> EpisodeSpec:
    kwargs = {name: value for name, value in spec.task_kwargs.items() if name not in arguments}
    return dataclasses.replace(spec, task_kwargs=kwargs)


def checked_plan(receipt: Receipt) -> EvaluationPlan:
    """Returns the plan of the episodes; raises a ValueError unless all that the receipt says agrees with the rest."""
    resets = {name: [result.reset for result in each] for name, each in receipt.results.items()}
    plan = EvaluationPlan.of(receipt.evaluation, {name: each for name, each in resets.items() if any(each)})
    if [*plan.specs] != [*receipt.results]:
        raise ValueError(f"there are episodes of {[*receipt.results]}, not of {[*plan.specs]}: the receipt was altered")
    for name, results in receipt.results.items():
        if len(results) != plan.num_episodes:
            raise ValueError(f"{name} has {len(results)} episodes, not {plan.num_episodes}: the receipt was altered")
        for index, (result, trace) in enumerate(zip(results, receipt.traces[name], strict=True)):
            if problem := _problem(plan, name, index, result, trace):
                raise ValueError(f"episode {index} of {name} {problem}: the receipt was altered")
    scores = {name: plan.scores(results) for name, results in receipt.results.items()}
    written = as_json(plan, scores)
    if difference := files.first_difference(receipt.evaluation, written):
        raise ValueError(f"the receipt was altered: {difference}, which follows from its episodes")
    # Numbers of other types are equal, but read otherwise.
    if json.dumps(receipt.evaluation, sort_keys=True) != json.dumps(written, sort_keys=True):
        raise ValueError("the receipt was altered: its scores are not numbers of the types that are written")
    if not MACHINE.fullmatch(receipt.machine):
        raise ValueError(f"the machine is none of those that are written: {checks.shown(receipt.machine)}")
    if (named := [*receipt.replaced]) != plan.replaced:
        problem = f"{plan.replaced} are not the protocol's values, but the receipt names {named}"
        raise ValueError(f"{problem}: it was altered, or the protocol is another one here")
    return plan


def _problem(plan: EvaluationPlan, name: str, index: int, result: EpisodeResult, trace: Trace) -> str:
    """Returns what is wrong with an episode by itself; empty if nothing is."""
    if (result.condition, result.episode, result.seed) != (name, index, plan.first.seed + index):
        return "is another one"
    steps = len(trace.actions)
    limit = plan.first.max_episode_steps
    if steps > limit or result.control_steps != (limit if result.diverged else steps):
        return f"has {steps} actions, not {result.control_steps}"
    numbers = [result.progress, *result.measures.values()]
    if not (np.isfinite(numbers).all() and np.isfinite(trace.actions).all()):
        return "has numbers that are not finite"
    if [*result.measures] != plan.measure_names[name]:
        return f"is measured by {[*result.measures]}, not by {plan.measure_names[name]}"
    return "has actions twice" if result.trace else ""


def _check_published(receipt: Receipt, path: Path) -> None:
    """Raises a ValueError unless a file holds the receipt's result."""
    found = files.load_json(path, "a result of kitchen-evaluate")
    if difference := files.first_difference(found, receipt.evaluation):
        raise ValueError(f"the published result {path} is not that of the receipt: {difference}")


def _check_goals(plan: EvaluationPlan, dataset: Path) -> None:
    """Raises a ValueError unless the goals of the episodes are those that their seeds take from a recording."""
    if not plan.resets:
        raise ValueError(f"the episodes take no goals from a dataset, such as {dataset}")
    if json.dumps(resets_of(plan, dataset)) != json.dumps(plan.resets):
        raise ValueError(f"the goals of the episodes are not those that their seeds take from {dataset}")


def _caveats(receipt: Receipt, dataset: Path | None) -> list[str]:
    """Returns what the first line says beside the protocol: what nobody has checked, and what needs no policy."""
    lines = []
    if "goals_sha256" in receipt.evaluation:
        unknown = "not verified, since their recording is not here: where the goals were taken from"
        lines.append(unknown if dataset is None else f"the goals are those of {dataset}")
    constant, total = constant_successes(receipt.results, receipt.traces)
    if constant:
        lines.append(f"{constant} of {total} successful episodes repeat one action from start to end")
    return lines


def _circumstances(receipt: Receipt, plan: EvaluationPlan) -> list[str]:
    """Returns lines on versions and machine, and on what is not verified."""
    lines = [f"versions: {', '.join(f'{name} {each}' for name, each in receipt.evaluation['versions'].items())}"]
    given = {name for condition in receipt.evaluation["conditions"].values() for name in condition["task_kwargs"]}
    if unseen := sorted(given & OF_PICTURES):
        lines.append(f"not verified, since none of the numbers depend on it: {', '.join(unseen)}")
    here = {**plan.first.current_versions, "processor": machine()}
    there: Mapping[str, Any] = {**receipt.evaluation["versions"], "processor": receipt.machine}
    differing = [name for name in here if here[name] != there.get(name)]
    return [*lines, *(f"made with {name} {there.get(name)}, here {here[name]}" for name in differing)]


def _table(compared: Mapping[str, list[ReplayedResult]]) -> str:
    rows = []
    for name, each in compared.items():
        first = [comparison.first for comparison in each if comparison.first is not None]
        equal = len(each) - len(first)
        same = sum(comparison.scores_alike for comparison in each)
        greatest = max(comparison.greatest for comparison in each)
        rows.append((name, str(len(each)), str(equal), str(same), str(min(first, default="none")), f"{greatest:.3g}"))
    return table(("condition", "episodes", "equal", "same result", "first difference", "greatest at the end"), rows)


def _print_differences(compared: list[ReplayedResult]) -> None:
    differing = [each for each in compared if each.first is not None or not each.scores_alike]
    for comparison in sorted(differing, key=lambda each: each.scores_alike)[:_MAX_LINES]:
        print_line(str(comparison))
    if len(differing) > _MAX_LINES:
        print_line(f"and {len(differing) - _MAX_LINES} further episodes")

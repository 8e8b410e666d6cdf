"""Evaluations as values: a plan, the results of its episodes, and their actions."""

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, files, suite
from kitchen_suite.episodes.recording import SPEC_FILE
from kitchen_suite.evaluation import quality, receipt
from kitchen_suite.evaluation.check import Check, ReplayedResult, check_of, replayed_results
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.evaluation.paired_scores import PairedScore, paired_conditions
from kitchen_suite.evaluation.plan import EvaluationPlan, check_robot
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.evaluation.receipt import Receipt
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.traces import Trace
from kitchen_suite.policies import PolicyRef
from kitchen_suite.versions import MACHINE, machine


class AlteredError(checks.WorkFailedError, ValueError):
    """A file that says of an evaluation what does not agree with the rest of it."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """A policy under a protocol: what was to be played, and what happened in each episode.

    Attributes:
      plan: what was evaluated.
      results: of the episodes of each condition, in order.
      traces: actions of the episodes, and digests of all their numbers, by condition; empty where the evaluation was
        read from JSON, which has none.
      machine: kind of processor that played the episodes; empty where the evaluation was read from JSON.
      path: the file that it was read from; None for one that was played by this process.
      answer_seconds: `(t,)`, how long each answer of the policy took [s], of those that were played by this call; files
        have no times.
    """

    plan: EvaluationPlan
    results: Mapping[str, Sequence[EpisodeResult]]
    traces: Mapping[str, Sequence[Trace]] = dataclasses.field(default_factory=dict)
    machine: str = dataclasses.field(default_factory=machine)
    path: Path | None = None
    answer_seconds: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def name(self) -> str:
        """The name of the policy for readers: that of the file, if it was read from one."""
        return PolicyRef.parse(self.plan.first.policy).without_file if self.path is None else self.path.stem

    @property
    def scores_by_condition(self) -> dict[str, dict[str, Any]]:
        """Scores of each condition, with intervals."""
        return {name: self.plan.scores(each) for name, each in self.results.items()}

    @property
    def scores(self) -> dict[str, Any]:
        """Scores of the first condition alone, or means over a sample; those of all are `scores_by_condition`."""
        return self.plan.main_scores(self.scores_by_condition)

    @property
    def overall(self) -> dict[str, float]:
        """The protocol's scores over all conditions; empty where it has none, or values that they depend on differ."""
        return _overall(self.plan, self.scores_by_condition)

    @property
    def shifts(self) -> dict[str, dict[str, PairedScore]]:
        """The effect of each condition, where the protocol has a control arm, as `shift` has; else empty.

        By condition and by name of a score, `success` first: the score of the condition, `a`, less that of the control
        arm, `b`, in episodes of the same seed, with its interval, and p-values adjusted for the number of conditions.
        """
        control = self.plan.control
        return paired_conditions(self.results, control) if control is not None else {}

    @property
    def constant_successes(self) -> tuple[int, int]:
        """Number of episodes that reach something by one and the same action, such as zeros, and of all such.

        An episode reaches something if it succeeds, or a measure of its protocol is true.
        """
        constant = total = 0
        for name, traces in self.traces.items():
            for result, trace in zip(self.results[name], traces, strict=True):
                if result.success or any(value is True for value in result.measures.values()):
                    total += 1
                    constant += bool((trace.actions == trace.actions[:1]).all())
        return constant, total

    @property
    def latency(self) -> tuple[float, float] | None:
        """Median and 95th percentile of the time that the policy's answers took [s]; None where none was played.

        An answer is the action for one observation, or the actions for a batch of them.
        """
        if not self.answer_seconds.size:
            return None
        middle, late = np.quantile(self.answer_seconds, (0.5, 0.95))
        return float(middle), float(late)

    @property
    def episode_rows(self) -> dict[str, list[dict[str, Any]]]:
        """The results of the episodes by condition, as JSON represents them."""
        return {name: [result.as_json() for result in each] for name, each in self.results.items()}

    def as_json(self) -> dict[str, Any]:
        """Returns what was evaluated, and all scores, as JSON represents it, without times, dates and paths."""
        return _as_json(self.plan, self.results)

    def write(self, path: str | Path) -> None:
        """Writes a receipt, whose name ends with `.npz`, or JSON, whose name ends with `.json`; it may be replaced.

        Both have the scores and the results of all episodes, and `Evaluation.read` reads both. A receipt has the
        actions as well, so that anyone can check it.

        Raises:
          OSError: the file cannot be written.
          ValueError: its name ends otherwise, or a receipt is to be written of an evaluation without actions, or of one
            that could not be read again: of too many episodes, or of a domain or robot that is not the suite's.
        """
        path = Path(path)
        if path.suffix == ".json":
            self.write_json(path)
        elif path.suffix == ".npz":
            self.require_actions("a receipt is made of")
            check_can_be_receipt(self.plan)
            contents = Receipt(
                evaluation=self.as_json(),
                replaced=self.plan.replaced,
                results=self.results,
                traces=self.traces,
                machine=self.machine,
            )
            contents.write(path)
        else:
            raise ValueError(f"an evaluation is written to a receipt, .npz, or to .json, not to {str(path)!r}")

    def write_json(self, path: Path, *, episodes: bool = True) -> None:
        """Writes JSON; without `episodes` it has the scores alone, which no one can read back or pair."""
        rows = {"episodes": self.episode_rows} if episodes else {}
        with files.atomic_write(path) as partial:
            files.write_json(partial, {**self.as_json(), **rows}, indent=1)

    def require_actions(self, use: str) -> None:
        """Raises a ValueError that names the remedy if there are no actions, whose use is said."""
        if not self.traces:
            problem = f"{self.name} has no actions, which {use}"
            raise ValueError(f"{problem}: evaluate with receipt, the path to write to, and read that")

    @classmethod
    def read(cls, path: str | Path) -> "Evaluation":
        """Reads the evaluation in a receipt, or in JSON with the results of its episodes.

        All that the file says is checked against the rest of it: names, seeds and lengths of the episodes, and scores.
        Nothing is played: see `check`.

        Raises:
          AlteredError: what the file says does not agree with the rest of it; a ValueError.
          OSError: the file cannot be read, or is none of an evaluation.
          ValueError: the path is that of a folder, or of JSON without episodes.
        """
        path = Path(path)
        if path.is_dir():
            raise ValueError(_problem_of_folder(path))
        if path.match("episode_*.npz") and (path.parent / SPEC_FILE).is_file():
            raise ValueError(f"{path} is an episode of a recording: name its folder, {path.parent}")
        return _read_json(path) if path.suffix == ".json" else _read_receipt(path)

    def check(
        self,
        *,
        num_envs: int = 16,
        num_threads: int | None = None,
        progress: Callable[[ReplayedResult], object] = lambda result: None,
    ) -> Check[ReplayedResult]:
        """Plays the actions of all episodes again, without the policy, and compares all numbers and scores.

        Args:
          num_envs: number of environments that are stepped together.
          num_threads: number of threads that step them; one per processor when None.
          progress: is called with each episode as it ends.

        Raises:
          AlteredError: the actions do not fit the environments.
          ValueError: the evaluation has no actions, or an argument is not valid.
        """
        checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
        if num_threads is not None:
            checks.integer(num_threads, "num_threads", minimum=1, maximum=checks.MAX_THREADS)
        self.require_actions("a check plays again")
        found: list[ReplayedResult] = []
        with contextlib.closing(
            replayed_results(self.plan, self.results, self.traces, num_envs, num_threads)
        ) as episodes:
            while True:
                with _altered(self.path):
                    episode = next(episodes, None)
                if episode is None:
                    return check_of(self.plan, found)
                found.append(episode)
                progress(episode)


def check_can_be_receipt(plan: EvaluationPlan) -> None:
    """Raises a ValueError unless a receipt of a plan's episodes could be read and checked."""
    if plan.first.domain_name not in suite.DOMAINS:
        raise ValueError(f"a receipt of domain {plan.first.domain_name!r} could not be verified: it is not the suite's")
    for spec in plan.specs.values():
        check_robot(spec.task_kwargs)
    episodes = plan.num_episodes * len(plan.specs)
    steps = episodes * plan.first.max_episode_steps
    size = episodes * receipt.ENTRY_SIZE + len(json.dumps([*plan.resets.values()]))
    if episodes > receipt.MAX_EPISODES or steps > receipt.MAX_STEPS or size > receipt.MAX_METADATA:
        limits = f"{receipt.MAX_EPISODES:,} episodes, fewer with goals, and {receipt.MAX_STEPS:,} control steps"
        raise ValueError(f"a receipt holds at most {limits}, not {episodes:,} and {steps:,}: evaluate fewer episodes")
    # What could not be read again.
    EvaluationPlan.of(plan.description, {name: [*each] for name, each in plan.resets.items()})
    receipt.check_texts(plan.description)


def _as_json(plan: EvaluationPlan, results: Mapping[str, Sequence[EpisodeResult]]) -> dict[str, Any]:
    """Returns the description with the scores: the main ones at the top, all by condition below."""
    scores = {name: plan.scores(each) for name, each in results.items()}
    description = plan.description
    conditions = {name: {**task, **scores[name]} for name, task in description.pop("conditions").items()}
    overall = _overall(plan, scores)
    of_all = {"overall": overall} if overall else {}
    return {**description, **plan.main_scores(conditions), **of_all, "conditions": conditions}


def _overall(plan: EvaluationPlan, scores: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    is_own = plan.score or any(plan.measures.values())
    return PROTOCOLS[plan.protocol].overall(scores) if is_own else {}


def _problem_of_folder(folder: Path) -> str:
    """Returns why a folder is no file of an evaluation, and what to name in its place."""
    if (folder / DESCRIPTION_FILE).is_file():
        flags = f"--output={folder} --resume --receipt=FILE.npz"
        return f"{folder} is the folder of an evaluation: write a file, by kitchen-evaluate with {flags}"
    if (folder / SPEC_FILE).is_file():
        return f"{folder} is the folder of a recording, which kitchen_suite.Recording.open reads"
    return f"{folder} is a folder, and not the file of an evaluation"


@contextlib.contextmanager
def _altered(path: Path | None) -> Iterator[None]:
    """Context in which a file that has been read makes no sense."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise AlteredError(f"{path}: {error}" if path else str(error)) from error


def _read_receipt(path: Path) -> Evaluation:
    contents = Receipt.read(path)
    with _altered(path):
        plan = _agreeing_plan(contents.evaluation, contents.results)
        for name, results in contents.results.items():
            for result, trace in zip(results, contents.traces[name], strict=True):
                if problem := problem_of_trace(plan, result, trace):
                    raise ValueError(f"episode {result.episode} of {name} {problem}: the receipt was altered")
        if not MACHINE.fullmatch(contents.machine):
            raise ValueError(f"the machine is none of those that are written: {checks.shown(contents.machine)}")
        if (named := [*contents.replaced]) != plan.replaced:
            problem = f"{plan.replaced} are not the protocol's values, but the receipt names {named}"
            raise ValueError(f"{problem}: it was altered, or the protocol is another one here")
    return Evaluation(plan=plan, results=contents.results, traces=contents.traces, machine=contents.machine, path=path)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Episodes:
    """Episodes in the JSON of an evaluation."""

    episodes: dict[str, list[EpisodeResult]]


def _read_json(path: Path) -> Evaluation:
    record = files.load_json(path, "the results of an evaluation")
    if not (isinstance(record, dict) and "protocol" in record):
        raise ValueError(f"{path} does not hold the results of an evaluation")
    if "episodes" not in record:
        raise ValueError(f"{path} holds scores without episodes: evaluate with --json and --episodes, or a receipt")
    with _altered(path):
        receipt.check_texts(record)
        results = files.parse({"episodes": record.pop("episodes")}, _Episodes, "not the episodes of an evaluation")
        plan = _agreeing_plan(record, results.episodes)
    return Evaluation(plan=plan, results=results.episodes, machine="", path=path)


def _agreeing_plan(record: Mapping[str, Any], results: Mapping[str, Sequence[EpisodeResult]]) -> EvaluationPlan:
    """Returns the plan of episodes; raises a ValueError unless all that a file says of them agrees with the rest.

    `record` is what `Evaluation.as_json` returned.
    """
    resets = {name: [result.reset for result in each] for name, each in results.items()}
    plan = EvaluationPlan.of(record, {name: each for name, each in resets.items() if any(each)})
    if [*plan.specs] != [*results]:
        raise ValueError(f"there are episodes of {[*results]}, not of {[*plan.specs]}: the file was altered")
    for name, each in results.items():
        if len(each) != plan.num_episodes:
            raise ValueError(f"{name} has {len(each)} episodes, not {plan.num_episodes}: the file was altered")
        for index, result in enumerate(each):
            if problem := problem_of_episode(plan, name, index, result):
                raise ValueError(f"episode {index} of {name} {problem}: the file was altered")
    if len({result.success_at_end is None for each in results.values() for result in each}) > 1:
        raise ValueError("some episodes alone say whether they end in success: the file was altered")
    written = _as_json(plan, results)
    if difference := files.first_difference(record, written):
        raise ValueError(f"the file was altered: {difference}, which follows from its episodes")
    # Numbers of other types are equal, but read otherwise.
    if json.dumps(record, sort_keys=True) != json.dumps(written, sort_keys=True):
        raise ValueError("the file was altered: its scores are not numbers of the types that are written")
    return plan


def problem_of_episode(plan: EvaluationPlan, name: str, index: int, result: EpisodeResult) -> str:
    """Returns what is wrong with an episode by itself; empty if nothing is."""
    if (result.condition, result.episode, result.seed) != (name, index, plan.first.seed_of(index)):
        return "is another one"
    if not np.isfinite([result.progress, *result.measures.values()]).all():
        return "has numbers that are not finite"
    limit = plan.first.max_episode_steps
    if not 1 <= result.control_steps <= limit or (result.diverged and result.control_steps != limit):
        return f"has {result.control_steps} control steps, of at most {limit}"
    if [*result.measures] != plan.measure_names[name]:
        return f"is measured by {[*result.measures]}, not by {plan.measure_names[name]}"
    steps = [step for step in (result.asked or {}).values() if step is not None]
    if steps and not 1 <= min(steps) <= max(steps) <= result.control_steps:
        return f"completes tasks at control steps {steps}, of {result.control_steps}"
    if result.diverged and (result.success or steps):
        return "has diverged, and completed something"
    if problem := _problem_of_success(plan, result):
        return problem
    clean = result.measures.get(quality.CLEAN_SUCCESS, False)
    if not isinstance(clean, bool) or (clean and not result.success):
        return f"has {quality.CLEAN_SUCCESS} {clean}, and success {result.success}"
    return ""


def _problem_of_success(plan: EvaluationPlan, result: EpisodeResult) -> str:
    """Returns what is wrong with when an episode succeeded, and whether that lasted; empty if nothing is."""
    at_end = result.success_at_end
    steps = result.steps_to_success
    if at_end is None:
        return "" if steps is None else "succeeds at a control step, and not whether at its end"
    if result.diverged and (at_end or steps is not None):
        return "has diverged, and succeeded"
    if at_end and not result.success:
        return "succeeds at its end, and does not succeed"
    if result.success and steps is None:
        return "succeeds at no control step"
    if steps is not None and steps > result.control_steps:
        return f"succeeds at control step {steps}, of {result.control_steps}"
    return ""


def problem_of_trace(plan: EvaluationPlan, result: EpisodeResult, trace: Trace) -> str:
    """Returns what is wrong with an episode's actions by themselves; empty if nothing is."""
    steps = len(trace.actions)
    limit = plan.first.max_episode_steps
    if steps > limit or result.control_steps != (limit if result.diverged else steps):
        return f"has {steps} actions, not {result.control_steps}"
    return "" if np.isfinite(trace.actions).all() else "has actions that are not finite"

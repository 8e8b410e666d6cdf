"""Evaluates policies under the protocols of publications."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import json
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from dm_control.rl.control import PhysicsError

from kitchen_suite import checks, suite
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.cluster import Cluster
from kitchen_suite.episodes.episode import EpisodeBuffer, Waiting, Watch
from kitchen_suite.episodes.play import Controller, SingleRollout, VectorEpisode, VectorRollout, make_controller
from kitchen_suite.episodes.report import TABLE_FORMATS, EpisodeBar, paragraph, print_line
from kitchen_suite.episodes.spec import EpisodeSpec, even_count, merged_kwargs, reset_to_seed
from kitchen_suite.evaluation import criteria, receipts, tables
from kitchen_suite.evaluation import quality as episode_quality
from kitchen_suite.evaluation.confirmed import format_changes
from kitchen_suite.evaluation.folder import EvaluationFolder, Key
from kitchen_suite.evaluation.plan import EvaluationPlan, Replaced, check_robot, make_plan
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.evaluation.receipts import Receipt, Trace, TraceRecorder
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import TIMESTEP, PolicyError, PolicyRef
from kitchen_suite.tasks.kitchen.requests import GOAL_STATES
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.vector_env.base import SuiteVectorEnv


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The results of a policy under a protocol.

    Attributes:
      plan: what was evaluated.
      results: of the episodes of each condition, in order.
    """

    plan: EvaluationPlan
    results: Mapping[str, list[EpisodeResult]]

    @property
    def scores_by_condition(self) -> dict[str, dict[str, Any]]:
        """Scores of each condition, with intervals."""
        return {name: self.plan.scores(each) for name, each in self.results.items()}

    @property
    def scores(self) -> dict[str, Any]:
        """Scores of the first condition, or means over a sample, such as `success`, `mean_tasks` and `intervals`."""
        return self.plan.main_scores(self.scores_by_condition)

    def as_json(self) -> dict[str, Any]:
        """Returns what was evaluated, and all scores, as JSON represents it, without times, dates and paths."""
        return as_json(self.plan, self.scores_by_condition)

    @property
    def episode_rows(self) -> dict[str, list[dict[str, Any]]]:
        """The results of the episodes by condition, as JSON represents them, from which `compare` can pair them."""
        return {name: [result.as_json() for result in each] for name, each in self.results.items()}

    def write_receipt(self, path: Path) -> None:
        """Writes the receipt of the episodes; raises a ValueError unless they were evaluated with traces."""
        if not all(result.trace for each in self.results.values() for result in each):
            raise ValueError("the actions of the episodes were not kept: evaluate with receipt, the path to write to")
        traces = {name: [Trace.from_text(result.trace) for result in each] for name, each in self.results.items()}
        receipt = Receipt(
            evaluation=self.as_json(), replaced=self.plan.replaced, results=dict(self.results), traces=traces
        )
        receipt.write(path)


def evaluate(
    policy: str | Path | PolicyRef | Callable[[Any], Any],
    *,
    protocol: str = "default",
    takes: str = TIMESTEP,
    domain_name: str = "kitchen",
    task_name: str | None = None,
    task_kwargs: Mapping[str, Any] | None = None,
    quality: bool = False,
    seed: int | None = None,
    num_episodes: int | None = None,
    max_episode_steps: int | None = None,
    dataset: str | Path | None = None,
    num_envs: int = 16,
    num_threads: int | None = None,
    cluster: Cluster | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    receipt: str | Path | None = None,
    verbose: bool = False,
    table_format: str = "text",
) -> Evaluation:
    """Evaluates a policy under a protocol.

    The same evaluation has the same results, whatever `num_envs`, `num_threads` and `cluster`.

    Args:
      policy: a name such as `expert`, the path of a trained policy, the address of a server, or a callable, which must
        have no memory where `num_envs` is more than 1; see `PolicyRef.of`.
      protocol: name of the protocol, a key of `PROTOCOLS`.
      takes: what a callable is called with: `timestep`, `observation` or `batch`.
      domain_name: of the environments.
      task_name: replaces the protocol's task.
      task_kwargs: arguments of the environments, which replace those of the protocol.
      quality: whether to measure how well episodes are done, `clean_success` among others; see docs/guide/quality.md.
      seed: of the first episode of each condition; the protocol's when None.
      num_episodes: of each condition; the protocol's when None.
      max_episode_steps: control steps after which an episode ends; the protocol's when None.
      dataset: folder of a recording, from whose episodes some protocols take their goals.
      num_envs: as in `kitchen_suite.play`.
      num_threads: as in `kitchen_suite.play`.
      cluster: as in `kitchen_suite.play`.
      output: folder that keeps the result of each episode, so that an interrupted evaluation can go on.
      resume: whether to continue the evaluation in `output`.
      receipt: file to write a receipt to, which `kitchen_suite.replay` checks without the policy.
      verbose: whether to print the scores of each condition as soon as they are there.
      table_format: of what is printed: `text`, `markdown` or `latex`.

    Raises:
      OSError: a file or folder cannot be read or written.
      PolicyError: the policy cannot be built, raises an exception, or returns a bad action.
      ValueError: an argument is not valid.
    """
    reference = PolicyRef.of(policy, takes)
    checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
    checks.choice(table_format, TABLE_FORMATS, "table_format")
    if resume and output is None:
        raise ValueError("an evaluation is resumed in its folder, output")
    if resume and reference.function is not None:
        raise ValueError("an evaluation of an object is not resumed: nothing says that it is the same policy")
    if receipt is not None and not Path(receipt).absolute().parent.is_dir():
        raise FileNotFoundError(f"there is no folder {str(Path(receipt).parent)!r} for the receipt")
    kwargs = merged_kwargs(task_kwargs or {}, {"quality": checks.boolean(quality, "quality") or None})
    replaced = Replaced(
        domain_name=domain_name,
        task_name=task_name,
        task_kwargs=kwargs,
        seed=seed,
        num_episodes=num_episodes,
        max_episode_steps=max_episode_steps,
    )
    plan = make_plan(reference, protocol, replaced, None if dataset is None else Path(dataset))
    if receipt is not None:
        check_receipt(plan)
    folder = _open_folder(plan, None if output is None else Path(output), resume)
    if receipt is not None and not all(result.trace for result in folder.results.values()):
        raise ValueError(f"{output} has episodes without actions, so that no receipt can be written")
    if verbose:
        parts = [tables.format_heading(plan), format_changes(plan), tables.format_starts(plan, reference)]
        heading = "\n".join(filter(None, parts))
        print_line(paragraph(heading, table_format))
    results = {}
    successes = sum(result.success for result in folder.results.values())
    with EpisodeBar(len(_seeds(plan)), len(folder.results), successes) as bar:
        for name, spec in plan.specs.items():
            if waiting := _missing(plan, folder, name):
                recorded = receipt is not None
                if cluster is None:
                    played = _results(waiting, name, plan, reference, num_envs, num_threads, recorded)
                else:
                    threads = num_threads or 1
                    arguments = (name, plan, reference, num_envs, threads, recorded)
                    played = cluster.run(_play_part, arguments, waiting, num_threads=threads)
                with _withdrawn_without_results(folder), contextlib.closing(played):
                    for result in played:
                        folder.add(result)
                        bar.count(result.success)
            results[name] = [folder.results[name, index] for index in range(plan.num_episodes)]
            if verbose and not plan.is_sample:
                scores = plan.scores(results[name])
                formatted = tables.format_scores(name, spec.task_name, plan.num_episodes, scores, table_format)
                print_line(f"\n{formatted}")
    evaluation = Evaluation(plan=plan, results=results)
    if verbose and len(results) > 1:
        if plan.is_sample:
            summary = tables.format_sample(evaluation.scores, results, table_format)
        else:
            summary = tables.format_summary(evaluation.scores_by_condition, table_format)
        print_line(f"\n{summary}")
        if overall := evaluation.as_json().get("overall"):
            print_line(f"\n{tables.format_overall(overall, table_format)}")
    if receipt is not None:
        evaluation.write_receipt(Path(receipt))
    return evaluation


@contextlib.contextmanager
def _withdrawn_without_results(folder: EvaluationFolder) -> Iterator[None]:
    """Context in which results are made and written: if they cannot be, and there is none, nothing is left."""
    try:
        yield
    except (OSError, PolicyError):
        folder.withdraw()
        raise


def _seeds(plan: EvaluationPlan) -> dict[Key, int]:
    return {(name, index): plan.first.seed + index for name in plan.specs for index in range(plan.num_episodes)}


def _open_folder(plan: EvaluationPlan, output: Path | None, resume: bool) -> EvaluationFolder:
    if output is None:
        return EvaluationFolder()
    if resume:
        return EvaluationFolder.resume(output, plan.description, _seeds(plan))
    return EvaluationFolder.create(output, plan.description)


def _missing(plan: EvaluationPlan, folder: EvaluationFolder, name: str) -> list[tuple[int, int]]:
    """Returns the number and seed of each episode of a condition whose result is not in the folder."""
    seed = plan.specs[name].seed
    return [(index, seed + index) for index in range(plan.num_episodes) if (name, index) not in folder.results]


def _results(
    waiting: list[tuple[int, int]],
    name: str,
    plan: EvaluationPlan,
    policy: PolicyRef,
    num_envs: int,
    num_threads: int | None,
    recorded: bool,
) -> Generator[EpisodeResult, None, None]:
    """Yields the results of some episodes of a condition, with their traces if they are `recorded`."""
    spec = plan.specs[name]
    with contextlib.closing(spec.make_vector_env(even_count(len(waiting), num_envs), num_threads)) as environments:
        controller = make_controller(spec, policy, environments)
        for result, trace in play_condition(name, plan, environments, controller, Waiting(waiting), recorded=recorded):
            yield dataclasses.replace(result, trace=trace.as_text()) if trace else result


def _play_part(
    waiting: list[tuple[int, int]],
    name: str,
    plan: EvaluationPlan,
    reference: PolicyRef,
    num_envs: int,
    num_threads: int,
    recorded: bool,
) -> list[EpisodeResult]:
    """Plays some episodes in a process of a cluster."""
    return [*_results(waiting, name, plan, reference, num_envs, num_threads, recorded)]


def play_again(plan: EvaluationPlan, policy: PolicyRef, num_episodes: int, watch: Watch) -> None:
    """Plays the first episodes of each condition of an evaluation once more, as they were evaluated.

    Where there are several conditions, the name of an episode begins with that of its condition.
    """
    for name, spec in plan.specs.items():
        builder = policy.builder(spec.policy_sha256)
        rollout = SingleRollout(spec, builder, action_dtype=np.float32, visuals=True, render_quality="fast")
        prefix = f"{name}, " if len(plan.specs) > 1 else ""

        def watch_named(buffer: EpisodeBuffer, environment: Environment, prefix: str = prefix) -> None:
            if not buffer.steps:
                buffer.name = prefix + buffer.name
            watch(buffer, environment)

        with contextlib.closing(rollout.environment):
            for index in range(num_episodes):
                # An episode is watched until its physics diverges.
                with contextlib.suppress(PhysicsError):
                    rollout.play(index, spec.seed + index, watch_named, plan.reset_options(name, index))


def as_json(plan: EvaluationPlan, scores: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Returns the description with the scores: the main ones at the top, all by condition below."""
    description = plan.description
    conditions = {name: {**task, **scores[name]} for name, task in description.pop("conditions").items()}
    is_own = plan.score or any(plan.measures.values())
    overall = PROTOCOLS[plan.protocol].overall(scores) if is_own else {}
    of_all = {"overall": overall} if overall else {}
    return {**description, **plan.main_scores(conditions), **of_all, "conditions": conditions}


def check_receipt(plan: EvaluationPlan) -> None:
    """Raises a ValueError unless a receipt of the episodes could be verified."""
    if plan.first.domain_name not in suite.DOMAINS:
        raise ValueError(f"a receipt of domain {plan.first.domain_name!r} could not be verified: it is not the suite's")
    for spec in plan.specs.values():
        check_robot(spec.task_kwargs)
    episodes = plan.num_episodes * len(plan.specs)
    steps = episodes * plan.first.max_episode_steps
    size = episodes * receipts.ENTRY_SIZE + len(json.dumps([*plan.resets.values()]))
    if episodes > receipts.MAX_EPISODES or steps > receipts.MAX_STEPS or size > receipts.MAX_METADATA:
        limits = f"{receipts.MAX_EPISODES:,} episodes, fewer with goals, and {receipts.MAX_STEPS:,} control steps"
        raise ValueError(f"a receipt holds at most {limits}, not {episodes:,} and {steps:,}: evaluate fewer episodes")
    # What could not be read again.
    EvaluationPlan.of(plan.description, {name: [*each] for name, each in plan.resets.items()})
    receipts.check_texts(plan.description)


def play_condition(
    name: str,
    plan: EvaluationPlan,
    environments: SuiteVectorEnv,
    controller: Controller,
    waiting: Waiting,
    *,
    recorded: bool,
) -> Iterator[tuple[EpisodeResult, Trace | None]]:
    """Yields result and trace of each episode of the condition of a name as it ends.

    `waiting` has the numbers and seeds of the episodes. Traces take some percent of the time; without `recorded` they
    are None.
    """
    spec, measures, resets = plan.specs[name], plan.measures[name], plan.resets.get(name, ())
    recorder = TraceRecorder(environments, controller) if recorded or measures else None
    for index, episode in VectorRollout(environments, recorder or controller, resets).play(waiting):
        reset = plan.reset_options(name, index)
        key = {"condition": name, "episode": index, "seed": spec.seed + index, "reset": reset}
        result = _result(environments.composer_task, spec, episode, key)
        trace = recorder.trace(episode) if recorder else None
        if recorder and measures:
            states = recorder.observations(episode)[:, criteria.STATE]
            goals = np.array(reset.get(GOAL_STATES, ()))
            own = {key: of(states, goals) for key, of in measures.items()}
            result = dataclasses.replace(result, measures={**own, **result.measures})
        yield result, trace if recorded else None


def _result(task: SuiteTask, spec: EpisodeSpec, episode: VectorEpisode, key: Mapping[str, Any]) -> EpisodeResult:
    """Returns the result of an episode; of one whose physics has diverged that of its start, as a failure."""
    if not episode.diverged:
        infos = episode.last_info
        result = EpisodeResult.of(task, infos, control_steps=int(infos["episode_step"]), **key)
        return _with_quality(result, spec, infos)
    with contextlib.closing(spec.make_environment()) as environment:
        _, infos = reset_to_seed(environment, key["seed"], spec.seeding, key["reset"])
        task = suite_env(environment).composer_task
        result = EpisodeResult.of(task, infos, control_steps=spec.max_episode_steps, diverged=True, **key)
    return _with_quality(dataclasses.replace(result, success=False), spec, infos)


def _with_quality(result: EpisodeResult, spec: EpisodeSpec, infos: Mapping[str, Any]) -> EpisodeResult:
    """Returns a result with the measures of the episode's quality, where it is measured, from its last infos."""
    if not spec.argument("quality"):
        return result
    return dataclasses.replace(result, measures=episode_quality.measures(result.success, infos))

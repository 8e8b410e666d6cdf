"""The work of `kitchen-evaluate`."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import collections
import contextlib
import dataclasses
import json
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np
from dm_control.rl.control import PhysicsError

from kitchen_suite import files, policies, suite
from kitchen_suite.episodes.episode import EpisodeBuffer, Waiting
from kitchen_suite.episodes.play import Controller, PolicyController, SingleRollout, VectorEpisode, VectorRollout
from kitchen_suite.episodes.report import EpisodeBar, counted, print_line, table
from kitchen_suite.episodes.spec import EpisodeSpec, reset_to_seed
from kitchen_suite.episodes.views import Page, PageStep
from kitchen_suite.evaluation import criteria, receipts
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE, EPISODES_FILE, EvaluationFolder, Key
from kitchen_suite.evaluation.plan import EvaluationPlan, check_robot, make_plan
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.evaluation.receipts import Receipt, Trace, TraceRecorder
from kitchen_suite.evaluation.results import EpisodeResult, score_episodes
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyError
from kitchen_suite.rendering import cameras
from kitchen_suite.settings import FAILURE, USAGE, EvaluateSettings
from kitchen_suite.tasks.kitchen.requests import GOAL_STATES
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Beginnings of the names of scores that are means in a unit of their own; all others are rates.
_MEANS = ("mean_", "control_steps", "score", "d4rl_score", "subtasks")
_ENTROPY = "order entropy [bit]"


def format_heading(plan: EvaluationPlan) -> str:
    """Returns the line above the scores: what is evaluated, and on which episodes."""
    first, varied = plan.first, {spec.variations for spec in plan.specs.values()}
    each = " of each condition" if len(plan.specs) > 1 else ""
    variations = first.variations if len(varied) == 1 else "variations by condition"
    played = f"{first.domain_name}, policy {policies.without_file(first.policy)}, protocol {plan.protocol}"
    return f"{played}, {variations}: {counted(plan.num_episodes)}{each}, seeds from {first.seed}"


def format_scores(name: str, task_name: str, num_episodes: int, scores: Mapping[str, Any]) -> str:
    """Returns the tables of a condition: its scores with intervals, and the rates of single tasks if there are any."""
    title = task_name if name == task_name else f"{name} ({task_name})"
    intervals = scores["intervals"]
    rows = [(_label(key), _text(key, scores[key]), _interval(key, intervals[key])) for key in intervals]
    if entropy := _entropy(scores):
        rows.append((_ENTROPY, entropy, ""))
    parts = [table((title, counted(num_episodes), "95 % interval"), rows)]
    if "task_rates" in scores:
        tasks = []
        for task, row in scores["task_rates"].items():
            counts = f"{row['completed']} of {row['asked']}"
            tasks.append((task, _text("rate", row["rate"]), _interval("rate", row["interval"]), counts))
        parts.append(table(("task", "completed", "95 % interval", "where asked"), tasks))
    if diverged := scores["diverged_seeds"]:
        where = f"the physics diverged in {counted(len(diverged))}"
        parts.append(f"{where}, counted as failures that completed nothing: seeds {diverged}")
    return "\n\n".join(parts)


def format_summary(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns the table of all conditions: a row for each, without intervals."""
    keys = list(dict.fromkeys(key for each in scores.values() for key in each["intervals"]))
    rows = []
    for name, each in scores.items():
        rows.append((name, *(_text(key, each[key]) if key in each else "" for key in keys), _entropy(each)))
    return table(("condition", *map(_label, keys), _ENTROPY), rows)


def _entropy(scores: Mapping[str, Any]) -> str:
    return f"{scores['order_entropy']:.2f}" if "order_entropy" in scores else ""


def _label(key: str) -> str:
    return key.replace("_", " ").replace("d4rl", "D4RL")


def _text(key: str, value: float) -> str:
    return f"{value:.4g}" if key.startswith(_MEANS) else f"{100 * value:.1f} %"


def _interval(key: str, interval: list[float] | None) -> str:
    if interval is None:
        return "none"
    low, high = (_text(key, bound) for bound in interval)
    return f"{low} to {high}"


class EpisodePage:
    """Plays the first episodes of each condition again, as they were evaluated, for a web page, if one is asked for."""

    def __init__(self, settings: EvaluateSettings, plan: EvaluationPlan) -> None:
        self._settings, self._plan = settings, plan
        self._count = min(settings.web_episodes, plan.num_episodes)
        self._page = Page(settings, num_episodes=self._count * len(plan.specs))
        if settings.web:
            with contextlib.closing(plan.first.make_environment()) as environment:
                cameras.find_camera(suite_env(environment).environment.physics, settings.camera)

    def write(self) -> None:
        if self._settings.web is None:
            return
        with self._page.open() as show:
            for name, spec in self._plan.specs.items():
                self._play(name, spec, show)

    def _play(self, name: str, spec: EpisodeSpec, show: PageStep) -> None:
        """Plays the episodes of a condition, whose names begin with that of the condition if there are several."""
        prefix = f"{name}, " if len(self._plan.specs) > 1 else ""
        rollout = SingleRollout(spec, visuals=True, render_quality="fast")
        environment = suite_env(rollout.environment).environment

        def watch(buffer: EpisodeBuffer) -> None:
            if not buffer.steps:
                buffer.name = prefix + buffer.name
            show(buffer, environment)

        with contextlib.closing(rollout.environment):
            for index in range(self._count):
                # The page has an episode until its physics diverges.
                with contextlib.suppress(PhysicsError):
                    rollout.play(index, spec.seed + index, watch, self._plan.reset_options(name, index))


class EvaluateJob:
    """Plays the episodes of a protocol, and scores them."""

    errors: ClassVar = {PolicyError: USAGE, OSError: FAILURE}

    def __init__(self, settings: EvaluateSettings) -> None:
        if settings.resume and settings.output is None:
            raise ValueError("--resume needs --output, the folder of the evaluation")
        own = [settings.output / name for name in (DESCRIPTION_FILE, EPISODES_FILE)] if settings.output else []
        paths = [path.resolve() for path in (settings.json, settings.receipt, settings.web, *own) if path]
        if len({*paths}) < len(paths):
            raise ValueError("--json, --receipt and --web must be different files, and none of --output's own")
        self._settings, self._plan = settings, make_plan(settings)
        self._page = EpisodePage(settings, self._plan)
        if settings.receipt:
            check_receipt(self._plan)
        self._folder = self._open_folder()
        if settings.receipt and not all(result.trace for result in self._folder.results.values()):
            raise ValueError(f"{settings.output} has episodes without actions, so that no --receipt can be written")

    def progress(self) -> str:
        finished = f"after {len(self._folder.results)} of {len(self._seeds)} episodes"
        return f"{finished}; the same command with --resume continues" if self._settings.output else finished

    def run(self) -> bool:
        """Plays the missing episodes, condition by condition; prints the scores, and writes JSON and web page."""
        plan = self._plan
        print_line(format_heading(plan))
        scores: dict[str, dict[str, Any]] = {}
        found = self._folder.results
        with EpisodeBar(len(self._seeds), len(found), sum(result.success for result in found.values())) as bar:
            for name, spec in plan.specs.items():
                self._play(name, spec, bar)
                scores[name] = score_episodes(self._results(name), plan.score)
                print_line(f"\n{format_scores(name, spec.task_name, plan.num_episodes, scores[name])}")
        if len(scores) > 1:
            print_line(f"\n{format_summary(scores)}")
        written = as_json(plan, scores)
        if "overall" in written:
            rows = [(_label(name), f"{value:.4g}") for name, value in written["overall"].items()]
            print_line(f"\n{table(('over all conditions', ''), rows)}")
        if self._settings.json:
            with files.atomic_write(self._settings.json) as partial:
                files.write_json(partial, written, indent=1)
        if self._settings.receipt:
            results = {name: self._results(name) for name in plan.specs}
            traces = {name: [Trace.from_text(result.trace) for result in each] for name, each in results.items()}
            receipt = Receipt(evaluation=written, replaced=plan.replaced, results=results, traces=traces)
            receipt.write(self._settings.receipt)
        self._page.write()
        return True

    def _results(self, name: str) -> list[EpisodeResult]:
        return [self._folder.results[name, index] for index in range(self._plan.num_episodes)]

    def _open_folder(self) -> EvaluationFolder:
        settings = self._settings
        if settings.output is None:
            return EvaluationFolder()
        if settings.resume:
            return EvaluationFolder.resume(settings.output, self._plan.description, self._seeds)
        return EvaluationFolder.create(settings.output, self._plan.description)

    @property
    def _seeds(self) -> dict[Key, int]:
        plan = self._plan
        return {(name, index): plan.first.seed + index for name in plan.specs for index in range(plan.num_episodes)}

    def _play(self, name: str, spec: EpisodeSpec, bar: EpisodeBar) -> None:
        plan = self._plan
        missing = (index for index in range(plan.num_episodes) if (name, index) not in self._folder.results)
        waiting = collections.deque((index, spec.seed + index) for index in missing)
        if not waiting:
            return
        num_envs = spec.num_envs(len(waiting), self._settings.num_envs)
        with contextlib.closing(spec.make_vector_env(num_envs, self._settings.num_threads)) as environments:
            controller = PolicyController(environments, spec.episode_policies())
            kept = self._settings.receipt is not None
            for result, trace in play(name, plan, environments, controller, waiting, recorded=kept):
                self._folder.add(dataclasses.replace(result, trace=trace.as_text()) if trace else result)
                bar.count(result.success)


def as_json(plan: EvaluationPlan, scores: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Returns the description with the scores: those of the first condition at the top, all by condition below."""
    description = plan.description
    conditions = {name: {**task, **scores[name]} for name, task in description.pop("conditions").items()}
    is_own = plan.score or any(plan.measures.values())
    overall = PROTOCOLS[plan.protocol].overall(scores) if is_own else {}
    of_all = {"overall": overall} if overall else {}
    return {**description, **next(iter(conditions.values())), **of_all, "conditions": conditions}


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


def play(
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
            result = dataclasses.replace(result, measures={key: of(states, goals) for key, of in measures.items()})
        yield result, trace if recorded else None


def _result(task: SuiteTask, spec: EpisodeSpec, episode: VectorEpisode, key: Mapping[str, Any]) -> EpisodeResult:
    """Returns the result of an episode; of one whose physics has diverged that of its start, as a failure."""
    if not episode.diverged:
        infos = episode.last_info
        return EpisodeResult.of(task, infos, control_steps=int(infos["episode_step"]), **key)
    with contextlib.closing(spec.make_environment()) as environment:
        _, infos = reset_to_seed(environment, key["seed"], spec.seeding, key["reset"])
        task = suite_env(environment).composer_task
        result = EpisodeResult.of(task, infos, control_steps=spec.max_episode_steps, diverged=True, **key)
    assert not result.success
    return result

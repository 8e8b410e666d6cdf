"""The work of `kitchen-evaluate`."""

import collections
import contextlib
import json
from collections.abc import Mapping
from typing import Any

from kitchen_suite import files
from kitchen_suite.evaluation import report
from kitchen_suite.evaluation.episode_page import EpisodePage
from kitchen_suite.evaluation.episode_results import EpisodeResult, score_episodes
from kitchen_suite.evaluation.folder import EvaluationFolder, Key
from kitchen_suite.evaluation.plan import make_plan
from kitchen_suite.evaluation.settings import EvaluateSettings
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyError
from kitchen_suite.rollouts.controllers import PolicyController
from kitchen_suite.rollouts.report import EpisodeBar, print_line
from kitchen_suite.rollouts.runners import even_count
from kitchen_suite.rollouts.spec import RecordingSpec, reset_to_seed
from kitchen_suite.rollouts.vector_rollout import EndedEpisode, VectorRollout
from kitchen_suite.vector_env.base import SuiteVectorEnv


class EvaluateJob:
    """Plays the episodes of a protocol, and scores them."""

    failures = (OSError,)
    usage_errors = (PolicyError,)

    def __init__(self, settings: EvaluateSettings) -> None:
        """Prepares the evaluation, so that bad settings are refused before the first episode.

        Raises:
          ImportError: an extra is missing.
          OSError: the folder cannot be written to or holds another evaluation, or the assets are missing.
          TypeError: an argument of the task has the wrong type, or there is no such argument.
          ValueError: an unknown name, a value that is refused, or a folder with another evaluation.
        """
        if settings.resume and settings.output is None:
            raise ValueError("--resume needs --output, the folder of the evaluation")
        self._settings, self._plan = settings, make_plan(settings)
        self._page = EpisodePage(settings, self._plan)
        self._folder = self._open_folder()
        self._results: dict[Key, EpisodeResult] = dict(self._folder.results) if self._folder else {}

    def progress(self) -> str:
        finished = f"after {len(self._results)} of {len(self._seeds)} episodes"
        return f"{finished}; the same command with --resume continues" if self._folder else finished

    def run(self) -> bool:
        """Plays the episodes that are missing, condition by condition; prints the scores, and writes JSON and web page.

        Raises:
          OSError: a file cannot be written.
          PolicyError: the policy raised an exception, or returned a bad action.
        """
        plan = self._plan
        print_line(report.heading(plan.description))
        scores: dict[str, dict[str, Any]] = {}
        successes = sum(result.success for result in self._results.values())
        with EpisodeBar(len(self._seeds), len(self._results), successes) as bar:
            for name, spec in plan.specs.items():
                self._play(name, spec, bar)
                results = [self._results[name, index] for index in range(plan.num_episodes)]
                scores[name] = score_episodes(results, plan.score)
                print_line(f"\n{report.condition(name, spec.task_name, plan.num_episodes, scores[name])}")
        if len(scores) > 1:
            print_line(f"\n{report.summary(scores)}")
        if self._settings.json:
            with files.atomic_write(self._settings.json) as partial:
                partial.write_text(json.dumps(self._as_json(scores), indent=1) + "\n", encoding="utf-8")
        self._page.write()
        return True

    def _open_folder(self) -> EvaluationFolder | None:
        settings = self._settings
        if settings.output is None:
            return None
        if settings.resume:
            return EvaluationFolder.resume(settings.output, self._plan.description, self._seeds)
        return EvaluationFolder.create(settings.output, self._plan.description)

    @property
    def _seeds(self) -> dict[Key, int]:
        """Seeds of all episodes."""
        plan = self._plan
        return {(name, index): plan.first.seed + index for name in plan.specs for index in range(plan.num_episodes)}

    def _play(self, name: str, spec: RecordingSpec, bar: EpisodeBar) -> None:
        """Plays the missing episodes of a condition."""
        waiting = collections.deque(
            (index, seed)
            for (condition, index), seed in self._seeds.items()
            if condition == name and (condition, index) not in self._results
        )
        if not waiting:
            return
        num_envs = even_count(len(waiting), self._settings.num_envs)
        with contextlib.closing(spec.make_vector_env(num_envs, self._settings.num_threads)) as environments:
            controller = PolicyController(environments, spec.find_policy())
            for index, episode in VectorRollout(environments, controller).play(waiting):
                key = {"condition": name, "episode": index, "seed": spec.seed + index}
                self._add(_result(environments, spec, episode, key))
                bar.count(self._results[name, index].success)

    def _add(self, result: EpisodeResult) -> None:
        if self._folder:
            self._folder.add(result)
        self._results[result.condition, result.episode] = result

    def _as_json(self, scores: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """Returns the description with the scores: those of the first condition at the top, all by condition below."""
        description = self._plan.description
        conditions = {name: {**task, **scores[name]} for name, task in description.pop("conditions").items()}
        return {**description, **next(iter(conditions.values())), "conditions": conditions}


def _result(
    environments: SuiteVectorEnv, spec: RecordingSpec, episode: EndedEpisode | None, key: Mapping[str, Any]
) -> EpisodeResult:
    """Returns the result of an episode; of one whose physics has diverged (None) that of its start, as a failure."""
    task = environments.template_env.environment.task
    if episode:
        infos = episode.last_info
        return EpisodeResult.of(task, infos, control_steps=int(infos["episode_step"]), **key)
    with contextlib.closing(spec.make_environment()) as environment:
        _, infos = reset_to_seed(environment, key["seed"], spec.seeding)
        task = suite_env(environment).environment.task
        result = EpisodeResult.of(task, infos, control_steps=spec.max_episode_steps, diverged=True, **key)
    assert not result.success
    return result

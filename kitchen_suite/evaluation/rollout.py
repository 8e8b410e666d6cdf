"""Plays the episodes of the conditions of an evaluation."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from dm_control.rl.control import PhysicsError
from numpy.typing import NDArray

from kitchen_suite.episodes.episode import Waiting, Watch
from kitchen_suite.episodes.play import Controller, VectorEpisode, VectorRollout, episode_name
from kitchen_suite.episodes.replay import replayed_steps
from kitchen_suite.episodes.spec import EpisodeSpec, reset_to_seed
from kitchen_suite.evaluation import criteria
from kitchen_suite.evaluation import quality as episode_quality
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.traces import Trace, TraceRecorder
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import OF_OBSERVATIONS
from kitchen_suite.tasks.kitchen.requests import GOAL_STATES
from kitchen_suite.vector_env.base import SuiteVectorEnv


class PlayedEpisode(NamedTuple):
    """An episode that has been played.

    Attributes:
      result: of the episode.
      trace: its actions, and digests of its numbers.
      answer_seconds: `(T,)`, how long the policy's answer of each control step took [s]; nothing is kept of it.
    """

    result: EpisodeResult
    trace: Trace
    answer_seconds: NDArray[np.float64] = np.zeros(0)


def play_condition(
    name: str,
    plan: EvaluationPlan,
    environments: SuiteVectorEnv,
    controller: Controller,
    waiting: Waiting,
) -> Iterator[PlayedEpisode]:
    """Yields result and trace of each episode of the condition of a name as it ends.

    `waiting` has the numbers and seeds of the episodes.
    """
    spec = plan.specs[name]
    measures = plan.measures[name]
    recorder = TraceRecorder(environments, controller)
    for index, episode in VectorRollout(environments, recorder, plan.resets.get(name, ())).play(waiting):
        reset = plan.reset_options(name, index)
        key = {"condition": name, "episode": index, "seed": spec.seed_of(index), "reset": reset}
        result = _result(environments, spec, episode, key)
        trace = recorder.trace(episode)
        if measures:
            states = recorder.observations(episode)[:, criteria.STATE]
            goals = np.array(reset.get(GOAL_STATES, ()))
            own = {key: of(states, goals) for key, of in measures.items()}
            result = dataclasses.replace(result, measures={**own, **result.measures})
        yield PlayedEpisode(result, trace, recorder.answer_seconds(episode))


def _result(
    environments: SuiteVectorEnv, spec: EpisodeSpec, episode: VectorEpisode, key: Mapping[str, Any]
) -> EpisodeResult:
    """Returns the result of an episode; of one whose physics has diverged that of its start, as a failure."""
    if not episode.diverged:
        infos = episode.last_info
        result = EpisodeResult.of(
            environments.composer_task,
            infos,
            control_steps=int(infos["episode_step"]),
            success_at_end=bool(environments.present_success[episode.i]),
            steps_to_success=episode.steps_to_success,
            **key,
        )
        return _with_quality(result, spec, infos)
    with contextlib.closing(spec.make_environment()) as environment:
        _, infos = reset_to_seed(environment, key["seed"], spec.seeding, key["reset"])
        task = suite_env(environment).composer_task
        result = EpisodeResult.of(task, infos, control_steps=spec.max_episode_steps, diverged=True, **key)
    failed = dataclasses.replace(result, success=False, success_at_end=False)
    return _with_quality(failed, spec, infos)


def _with_quality(result: EpisodeResult, spec: EpisodeSpec, infos: Mapping[str, Any]) -> EpisodeResult:
    """Returns a result with the measures of the episode's quality, where it is measured, from its last infos."""
    return dataclasses.replace(result, measures=episode_quality.measures(spec, result.success, infos))


def watch_episodes(
    plan: EvaluationPlan,
    results: Mapping[str, Sequence[EpisodeResult]],
    traces: Mapping[str, Sequence[Trace]],
    num_episodes: int,
    watch: Watch,
    render_quality: str = "fast",
) -> None:
    """Plays the actions of the first episodes of each condition again, for a video or a web page.

    Where there are several conditions, the name of an episode begins with that of its condition.
    """
    for name, spec in plan.specs.items():
        prefix = f"{name}, " if len(plan.specs) > 1 else ""
        shown = spec.without(OF_OBSERVATIONS)
        with contextlib.closing(shown.make_environment(visuals=True, render_quality=render_quality)) as environment:
            for result, trace in zip(results[name][:num_episodes], traces[name], strict=False):
                title = prefix + episode_name(result.episode, result.seed)
                steps = replayed_steps(
                    environment, result.seed, spec.seeding, result.reset or None, trace.actions, title
                )
                # An episode is watched until its physics diverges.
                with contextlib.suppress(PhysicsError):
                    for step in steps:
                        watch(*step)

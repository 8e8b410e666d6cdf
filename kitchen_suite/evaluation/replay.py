"""Checks recordings and receipts: their episodes are played again, and compared."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path

from kitchen_suite import files
from kitchen_suite.episodes.episode import Watch, ignore
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.replay import Replay, ReplayedEpisode
from kitchen_suite.evaluation.check import Check, ReplayedResult
from kitchen_suite.evaluation.evaluation import AlteredError, Evaluation
from kitchen_suite.evaluation.scores import EpisodeResult, score_episodes
from kitchen_suite.gymnasium_env.base import suite_env


def replay(
    path: str | Path,
    *,
    episodes: str | list[int] = "all",
    published: str | Path | None = None,
    dataset: str | Path | None = None,
    num_envs: int | None = None,
    num_threads: int | None = None,
) -> Check[ReplayedEpisode] | Check[ReplayedResult]:
    """Plays the episodes of a recording or a receipt again, and compares all numbers and scores.

    Args:
      path: folder of a recording, or file of a receipt.
      episodes: which episodes of a recording: `all`, numbers and ranges such as `0,5,7-9`, or a list of numbers.
      published: file of a result as JSON, such as `kitchen-evaluate` writes, which has to be that of a receipt.
      dataset: folder of the recording from which the goals of a receipt were taken.
      num_envs: number of environments in which the episodes of a receipt are stepped together; 16 when None.
      num_threads: number of threads that step them; one per processor when None.

    Returns the check, whose `verdict` is `equal`, `other digits` or `altered`; that of each episode is in `episodes`.

    Raises:
      AlteredError: a receipt does not agree with itself, or with the published result or the dataset.
      OSError: the file or folder cannot be read.
      ValueError: there are no such episodes, or an argument does not apply.
    """
    path = Path(path)
    if path.is_dir():
        if published is not None or dataset is not None:
            raise ValueError("a published result and a dataset are compared with a receipt, not with a recording")
        if num_envs is not None or num_threads is not None:
            raise ValueError("num_envs and num_threads are for receipts: the episodes of a recording are played singly")
        played = Replay(Recording.open(path), episodes, 1)
        with contextlib.closing(played.environment):
            return check_recording(played)
    if episodes != "all":
        raise ValueError("the episodes of a receipt are replayed all together")
    evaluation = Evaluation.read(path)
    if published is not None:
        check_published(evaluation, Path(published))
    if dataset is not None:
        check_goals(evaluation, Path(dataset))
    return evaluation.check(num_envs=16 if num_envs is None else num_envs, num_threads=num_threads)


def check_recording(
    played: Replay, watch: Watch = ignore, progress: Callable[[ReplayedEpisode], object] = lambda episode: None
) -> Check[ReplayedEpisode]:
    """Plays episodes of a recording again, and compares them.

    Args:
      played: the recording, with the episodes that are chosen.
      watch: is called after every reset and every step.
      progress: is called with each episode as it ends.
    """
    task = suite_env(played.environment).composer_task
    compared, results = [], []
    for episode in played.run(watch):
        progress(episode)
        compared.append(episode)
        key = {"condition": episode.condition, "episode": episode.episode, "seed": episode.seed}
        results.append(EpisodeResult.of(task, episode.last_info, control_steps=episode.steps, **key))
    scores = score_episodes(results, max_episode_steps=played.recording.spec.max_episode_steps)
    return Check(episodes=compared, scores=scores)


def check_published(evaluation: Evaluation, path: Path) -> None:
    """Raises an AlteredError unless a file of JSON holds the result of an evaluation."""
    found = files.load_json(path, "a result of kitchen-evaluate")
    expected = evaluation.as_json()
    if isinstance(found, dict) and "episodes" in found:
        expected["episodes"] = evaluation.episode_rows
    if difference := files.first_difference(found, expected):
        raise AlteredError(f"the published result {path} is not that of the receipt: {difference}")
    # Numbers of other types are equal, but read otherwise.
    if json.dumps(found, sort_keys=True) != json.dumps(expected, sort_keys=True):
        raise AlteredError(f"the published result {path} is not that of the receipt: it has numbers of other types")


def check_goals(evaluation: Evaluation, dataset: Path) -> None:
    """Raises an AlteredError unless the goals of the episodes are those that their seeds take from a recording."""
    if not evaluation.plan.resets:
        raise AlteredError(f"the episodes take no goals from a dataset, such as {dataset}")
    if json.dumps(evaluation.plan.draw_resets(dataset)) != json.dumps(evaluation.plan.resets):
        raise AlteredError(f"the goals of the episodes are not those that their seeds take from {dataset}")

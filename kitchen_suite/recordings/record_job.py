"""What `kitchen-record` does once its flags are read."""

import collections
import contextlib
import dataclasses
import functools
import math
import sys
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

from kitchen_suite import policies
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings.folder import RecordingFolder
from kitchen_suite.recordings.minari_dataset import DatasetPlan
from kitchen_suite.recordings.record_worker import RecordWorker
from kitchen_suite.recordings.spec import RecordingSpec
from kitchen_suite.rollouts.episode import EpisodeStats
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays, results
from kitchen_suite.rollouts.progress import EpisodeBar
from kitchen_suite.rollouts.report import Report
from kitchen_suite.rollouts.vector_rollout import VectorRollout
from kitchen_suite.suite import default_task
from kitchen_suite.workers.cluster import Cluster


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """What is asked for; see the flags of `record`."""

    domain_name: str
    task_name: str | None
    task_kwargs: Mapping[str, Any]
    policy: str
    num_episodes: int
    seed: int
    max_episode_steps: int | None
    num_envs: int
    num_threads: int | None
    cluster: Cluster | None
    output: Path
    dataset: str | None

    @property
    def processes(self) -> int:
        """How many play."""
        return self.cluster.workers if self.cluster else 1


# Numbers of episodes, and what happened in them; None if the physics diverged.
_Ended = Generator[tuple[int, EpisodeArrays | None], None, None]


class DivergedError(Exception):
    """The physics diverged in some episodes, which were left out."""


class RecordJob:
    """A recording to be made, or to be completed."""

    def __init__(self, settings: Settings) -> None:
        """Makes everything ready, so that nothing that can be known to be wrong stops the job later.

        Raises:
          ImportError: Minari is missing, but a dataset is asked for.
          OSError: the folder cannot be written to or holds other episodes, or the assets are missing.
          TypeError: an argument of the task has the wrong type, or there is no such argument.
          ValueError: an unknown name, a value that is refused, or a folder or dataset that holds something else.
        """
        self._settings = settings
        self._recipe = RecordingSpec.make(
            domain_name=settings.domain_name,
            task_name=settings.task_name or default_task(settings.domain_name),
            task_kwargs=settings.task_kwargs,
            policy=settings.policy,
            seed=settings.seed,
            max_episode_steps=settings.max_episode_steps,
        )
        self._single = self._recipe.environment()
        self._wanted = range(settings.num_episodes)
        self._plan = self._plan_dataset()
        self._staging = RecordingFolder.claim(settings.output, self._recipe)
        self._found = len(self._present())

    @property
    def finished(self) -> int:
        """Number of wanted episodes that are written."""
        return len(self._present())

    def run(self) -> None:
        """Plays what is missing, makes the dataset, and prints a summary, also of what was finished before an error.

        Raises:
          ClusterError: the workers cannot be had, or do not get anywhere.
          DivergedError: at the end, if some episodes are missing.
        """
        settings, recipe = self._settings, self._recipe
        print(f"{recipe.domain_name} {recipe.task_name}, policy {recipe.policy}, seeds from {recipe.seed}")
        print(f"{settings.num_episodes} episodes in {settings.output}, {self._found} of them there already")
        sys.stdout.flush()
        try:
            with contextlib.closing(self._single):
                diverged = self._play()
                if self._plan and self._plan.is_missing:
                    self._plan.make(self._single, self._staging, self._present())
        finally:
            print(f"\n{self._summary()}")
        if self._plan:
            print(f"dataset {self._plan.dataset_id} in {self._plan.path}")
        if diverged:
            raise DivergedError(f"the physics diverged in {len(diverged)} episodes, left out: seeds {diverged}")

    def _plan_dataset(self) -> DatasetPlan | None:
        if self._settings.dataset is None:
            return None
        return DatasetPlan(self._settings.dataset, self._recipe, self._settings.num_episodes)

    def _play(self) -> list[int]:
        """Plays and saves what is missing; returns the seeds of episodes in which the physics diverged."""
        present = set(self._present())
        missing = [(index, self._recipe.seed + index) for index in self._wanted if index not in present]
        if not missing:
            return []
        single, diverged = suite_env(self._single), []
        with contextlib.closing(self._ended(missing)) as ended, self._progress() as bar:
            for index, episode in ended:
                if episode is None:
                    diverged.append(self._recipe.seed + index)
                    continue
                came_of_it = results(single, episode.arrays)
                seconds = episode.seconds / self._settings.processes
                self._staging.save(dataclasses.replace(episode, seconds=seconds), came_of_it)
                bar.count(bool(came_of_it["success"]))
        return sorted(diverged)

    def _ended(self, missing: Sequence[tuple[int, int]]) -> _Ended:
        """Plays episodes of given numbers and seeds, here or by workers; gives each as `VectorRollout.play` does."""
        settings, recipe, cluster = self._settings, self._recipe, self._settings.cluster
        at_once = min(settings.num_envs, math.ceil(len(missing) / settings.processes))
        if cluster:
            num_threads = settings.num_threads or 1
            build = functools.partial(RecordWorker, recipe, at_once, num_threads)
            yield from cluster.play(build, missing, capacity=at_once, num_threads=num_threads)
            return
        with contextlib.closing(recipe.environments(at_once, settings.num_threads)) as environments:
            recorder = VectorRollout(environments, suite_env(self._single), policies.find(recipe.policy))
            yield from recorder.play(collections.deque(missing))

    def _progress(self) -> EpisodeBar:
        successes = sum(self._staging.outcome(index)["results"]["success"] for index in self._present())
        return EpisodeBar(len(self._wanted), self._found, successes)

    def _present(self) -> list[int]:
        return [index for index in self._staging.indices if index in self._wanted]

    def _summary(self) -> str:
        report = Report(last_seed=self._recipe.seed + len(self._wanted) - 1)
        for index in self._present():
            known = self._staging.outcome(index)
            report.add(EpisodeStats(**{field.name: known[field.name] for field in dataclasses.fields(EpisodeStats)}))
        return report.summary()

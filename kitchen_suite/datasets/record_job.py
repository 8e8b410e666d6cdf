"""The work of `kitchen-record`, and the presets of demonstrations."""

import collections
import contextlib
import dataclasses
import functools
import math
import sys
from collections.abc import Generator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

from kitchen_suite import checks
from kitchen_suite.datasets.formats import FORMATS, MINARI, DatasetPlan
from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeStats, check_file_size
from kitchen_suite.episodes.play import VectorRunner, play_many
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.report import EpisodeBar, Report
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyError
from kitchen_suite.settings import FAILURE, USAGE, RecordSettings
from kitchen_suite.tasks.records import Metrics

_DEMONSTRATOR = "expert(action_noise=0.1, jitter=0.01)"
_UNDIRECTED = "undirected(action_noise=0.1, jitter=0.01{})"

# Size of the sets that are made as D4RL's `partial` and `mixed`.
_D4RL = {"num_episodes": 1_000, "max_episode_steps": 140}

# As many steps as OGBench's sets of play have.
_PLAY = {
    "task_name": "all",
    "task_kwargs": {"terminate_on_tasks_completed": False},
    "num_episodes": 1_000,
    "max_episode_steps": 1_000,
}

# Noise on actions and poses makes all episodes differ. The last five are for offline learning: docs/guide/offline.md.
KITCHEN_PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # Four tasks, always in the same order.
        "fixed_order": {"task_name": "complete", "policy": _DEMONSTRATOR},
        # Four of the seven, in an order drawn for each episode.
        "random_order": {"task_name": "random_4", "task_kwargs": {"tasks_in_turn": True}, "policy": _DEMONSTRATOR},
        # One to seven, in the order that suits the expert.
        "goal_conditioned": {"task_name": "all", "task_kwargs": {"tasks_per_episode": [1, 7]}, "policy": _DEMONSTRATOR},
        # The four tasks of D4RL's `complete`, always in the same order, in about as many episodes.
        "complete": {"task_name": "complete", "policy": _DEMONSTRATOR, "num_episodes": 20},
        # Tasks in random order; some episodes do the four that are rewarded, and no others.
        "partial": {"task_name": "partial", "policy": _UNDIRECTED.format(", directed=0.1"), **_D4RL},
        # Tasks in random order; no episode does all four that are rewarded.
        "mixed": {"task_name": "mixed", "policy": _UNDIRECTED.format(", spare_last=True"), **_D4RL},
        # All twenty tasks, without end: what has been done is undone.
        "play": {**_PLAY, "policy": _UNDIRECTED.format(", repertoire='twenty'")},
        # The same with large noise, and one uniform action in ten.
        "noisy": {**_PLAY, "policy": "undirected(action_noise=0.5, random_actions=0.1, repertoire='twenty')"},
    }
)


class PhysicsDivergedError(Exception):
    """The physics diverged in some episodes, which are missing from the recording."""


class RecordJob:
    """Makes a recording, or completes it."""

    errors: ClassVar = {PolicyError: USAGE, PhysicsDivergedError: FAILURE, OSError: FAILURE}

    def __init__(self, settings: RecordSettings) -> None:
        self._ray = settings.ray()
        self._settings = settings = _with_format(settings.resolved)
        self._spec = EpisodeSpec.of(settings, seeding="gymnasium")
        self._template_env = self._spec.make_environment()
        check_file_size(self._template_env.observation_space, self._spec.max_episode_steps)
        self._spec.check_policy(self._template_env)
        assert settings.num_episodes is not None, "they are resolved"
        self._wanted = range(settings.num_episodes)
        self._plan: DatasetPlan | None = None
        if settings.dataset is not None:
            chosen = FORMATS[settings.format or MINARI.name]
            self._plan = chosen.make_plan(settings.dataset, self._spec, settings.num_episodes, settings.data_path)
        self._folder = RecordingFolder.claim(settings.output, self._spec)
        self._found = len(self._present())

    def progress(self) -> str:
        return f"after {len(self._present())} of {len(self._wanted)} episodes; the same command completes the recording"

    def run(self) -> bool:
        """Plays the missing episodes, makes the dataset, and prints a summary, also after an error.

        Raises a PhysicsDivergedError at the end if episodes are missing because their physics diverged.
        """
        spec = self._spec
        print(f"{spec.domain_name} {spec.task_name}, policy {spec.policy}, {spec.variations}, seeds from {spec.seed}")
        print(f"{len(self._wanted)} episodes in {self._settings.output}, {self._found} of them there already")
        sys.stdout.flush()
        try:
            with contextlib.closing(self._template_env):
                diverged = self._play()
                if self._plan:
                    self._plan.complete(self._template_env, self._folder, self._present())
        finally:
            print(f"\n{self._summary()}")
        if not diverged:
            print(f"digest of all arrays  {self._folder.digest(self._wanted)}")
        if self._plan:
            print(f"dataset {self._plan.dataset_id} in {self._plan.path}")
        if diverged:
            raise PhysicsDivergedError(f"the physics diverged in {len(diverged)} episodes, left out: seeds {diverged}")
        return True

    def _play(self) -> list[int]:
        """Plays and saves the missing episodes; returns the seeds of those in which the physics diverged."""
        present = {*self._present()}
        missing = [(index, self._spec.seed + index) for index in self._wanted if index not in present]
        if not missing:
            return []
        task, diverged = suite_env(self._template_env).composer_task, []
        successes = sum(bool(self._load_stats(index).metrics["success"]) for index in present)
        bar = EpisodeBar(len(self._wanted), self._found, successes)
        with contextlib.closing(self._episodes(missing)) as episodes, bar:
            for index, episode in episodes:
                if episode is None:
                    diverged.append(self._spec.seed + index)
                    continue
                episode = dataclasses.replace(episode, seconds=episode.seconds / self._processes)
                stats = EpisodeStats.of(episode, task.records.metrics(episode.last_info))
                self._folder.save(episode, stats)
                bar.count(bool(stats.metrics["success"]))
        return sorted(diverged)

    def _episodes(self, missing: Sequence[tuple[int, int]]) -> Generator[tuple[int, EpisodeArrays | None], None, None]:
        """Yields episodes of given numbers and seeds as `play_many` does, played here or by workers."""
        # No more environments in each process than keep all of them playing to the end.
        num_envs = self._spec.num_envs(math.ceil(len(missing) / self._processes), self._settings.num_envs)
        num_threads = self._settings.num_threads
        if not self._ray:
            return play_many(self._spec, collections.deque(missing), num_envs, num_threads)
        build = functools.partial(VectorRunner, self._spec, num_envs, num_threads or 1)
        return self._ray.run(build, missing, capacity=num_envs, num_threads=num_threads or 1)

    @property
    def _processes(self) -> int:
        return self._ray.workers if self._ray else 1

    def _load_stats(self, index: int) -> EpisodeStats:
        """Reads the statistics of an episode; raises an OSError unless its metrics are those of the task."""
        stats, expected = self._folder.load_stats(index), suite_env(self._template_env).composer_task.episode_metrics
        if _types(stats.metrics) != _types(expected):
            raise OSError(f"episode {index} in {self._settings.output} has metrics {stats.metrics}, not {expected}")
        return stats

    def _present(self) -> list[int]:
        return [index for index in self._folder.indices if index in self._wanted]

    def _summary(self) -> str:
        report = Report(last_seed=self._spec.seed + len(self._wanted) - 1)
        for index in self._present():
            report.add(self._load_stats(index))
        return report.summary()


def _with_format(settings: RecordSettings) -> RecordSettings:
    if settings.format is None:
        return settings
    chosen = FORMATS[checks.choice(settings.format, FORMATS, "format")]
    if settings.dataset is None:
        raise ValueError(f"format {chosen.name!r} needs the name of a dataset: --dataset={chosen.example}")
    given = {} if settings.obs_type is None else {"obs_type": settings.obs_type}
    return dataclasses.replace(settings, task_kwargs=chosen.task_kwargs({**given, **settings.task_kwargs}))


def _types(metrics: Metrics) -> dict[str, type]:
    return {name: type(value) for name, value in metrics.items()}

"""The work of `kitchen-rollout`."""

import contextlib
import dataclasses
import functools
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from dm_control.rl.control import PhysicsError
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyError
from kitchen_suite.rendering.cameras import camera_names
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer, EpisodeStats, check_file_size
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.rollouts.report import EpisodeBar, Report, print_line
from kitchen_suite.rollouts.rollout import SingleRollout, SingleRunner
from kitchen_suite.rollouts.spec import EpisodeSpec
from kitchen_suite.rollouts.views import Views
from kitchen_suite.settings import WIDTH, RolloutSettings

if TYPE_CHECKING:
    from kitchen_suite.workers.cluster import RaySettings

# Shows a policy that succeeds, to those who have seen the random one.
_NEXT_COMMAND = "kitchen-rollout --domain_name=open_cabinet --policy=trained"


class RolloutJob:
    """Plays a number of episodes, reports and writes them."""

    failures = (PhysicsError, OSError)
    usage_errors = (PolicyError,)

    def __init__(self, settings: RolloutSettings) -> None:
        self._ray = settings.ray()
        if self._ray and (settings.video or settings.web):
            raise ValueError("workers make no video and no web page: leave out --workers")
        self._settings = settings
        self._spec = EpisodeSpec.of(settings, seeding="dm_control").observing()
        self._rollout = SingleRollout(self._spec, **settings.rendering)
        self._environment = suite_env(self._rollout.environment).environment
        if settings.output:
            check_file_size(self._rollout.environment.observation_space, self._spec.max_episode_steps)
        self._environment.task.visualize_reward = settings.visualize_reward
        steps = self._spec.max_episode_steps
        self._views = Views(settings, self._environment, num_episodes=settings.num_episodes, max_steps=steps)
        self._spec.check_policy(self._rollout.environment)
        self._folder = RecordingFolder.create(settings.output, self._spec) if settings.output else None
        self._report = Report(last_seed=settings.seed + settings.num_episodes - 1)

    @property
    def finished(self) -> int:
        """Number of episodes that have been played, and written."""
        return self._report.count

    def progress(self) -> str:
        return f"after {self.finished} of {self._settings.num_episodes} episodes"

    def run(self) -> bool:
        """Plays all episodes; prints a table row by row, and a summary, also of those finished before an error."""
        spec = self._spec
        print_line(f"{spec.domain_name} {spec.task_name}, policy {spec.policy}, {spec.variations}\n")
        try:
            with contextlib.closing(self._rollout.environment):
                if self._ray:
                    self._play_on_workers(self._ray)
                else:
                    self._play()
        finally:
            if self.finished:
                print_line(f"\n{self._report.summary()}")
        if self._settings == RolloutSettings():
            print_line(f"\nTry next: {_NEXT_COMMAND}")
        return True

    def _play(self) -> None:
        with self._watch() as watch:
            for index, seed in self._episodes:
                self._add(self._rollout.play(index, seed, watch))

    def _play_on_workers(self, ray: "RaySettings") -> None:
        ended = ray.run(functools.partial(SingleRunner, self._spec), self._episodes, capacity=1, num_threads=1)
        with contextlib.closing(ended), EpisodeBar(self._settings.num_episodes) as bar:
            for _, episode in ended:
                seconds = episode.seconds / ray.workers
                bar.count(self._add(dataclasses.replace(episode, seconds=seconds)))

    @property
    def _episodes(self) -> list[tuple[int, int]]:
        return [(index, self._settings.seed + index) for index in range(self._settings.num_episodes)]

    def _add(self, episode: EpisodeArrays) -> bool:
        """Writes an episode, and prints its row; returns whether it succeeded."""
        stats = EpisodeStats.of(episode, self._environment.task.metrics(episode.last_info))
        if self._folder:
            self._folder.save(episode, stats)
        print_line(self._report.add(stats, episode.index))
        return bool(stats.metrics["success"])

    @contextlib.contextmanager
    def _watch(self) -> Iterator[Callable[[EpisodeBuffer], None]]:
        """Yields the function to be called at every step: it moves the progress bar, and films the step."""
        settings, limit = self._settings, self._spec.max_episode_steps
        with (
            self._views.open() as view_step,
            tqdm(total=settings.num_episodes * limit, unit="step", disable=None, leave=False) as bar,
        ):
            left = settings.num_episodes

            def watch(buffer: EpisodeBuffer) -> None:
                nonlocal left
                view_step(buffer)
                bar.update(buffer.steps > 0)
                if buffer.has_ended:
                    left -= 1
                    bar.total = bar.n + left * limit

            yield watch


class ListJob:
    """Prints the lines of a list as they are made."""

    failures = (OSError,)
    usage_errors = ()

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = lines

    def progress(self) -> str:
        return "while listing"

    def run(self) -> bool:
        for line in self._lines:
            print_line(line)
        return True


def make_job(settings: RolloutSettings) -> RolloutJob | ListJob:
    """Returns the job that settings ask for."""
    return ListJob(_domains()) if settings.list else RolloutJob(settings)


def _domains() -> Iterator[str]:
    for domain, tasks in suite.TASKS_BY_DOMAIN.items():
        with contextlib.closing(suite.load(domain, tasks[0], task_kwargs={"visuals": False})) as environment:
            names = camera_names(environment.physics)
        yield "\n".join((domain, _listing("tasks", tasks), _listing("cameras", names)))


def _listing(title: str, names: Sequence[str]) -> str:
    return textwrap.fill(", ".join(names), WIDTH, initial_indent=f"  {title:<9}", subsequent_indent=" " * 11)

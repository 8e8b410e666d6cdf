"""What `kitchen-rollout` does once its flags are read."""

import contextlib
import dataclasses
import functools
import importlib.metadata
import math
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import dm_env
from tqdm import tqdm

import kitchen_suite
from kitchen_suite import policies, suite
from kitchen_suite.environment import Environment
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.rendering import video
from kitchen_suite.rendering.cameras import camera_names, check_size, find_camera
from kitchen_suite.rollouts import episode_files
from kitchen_suite.rollouts.episode import Episode, play
from kitchen_suite.rollouts.progress import EpisodeBar
from kitchen_suite.rollouts.report import WIDTH, Report
from kitchen_suite.rollouts.rollout_worker import RolloutWorker
from kitchen_suite.workers.cluster import Cluster

# Enough to follow a motion, and few enough to be rendered without a graphics card.
_POLICY_FPS = 12.5

# Whose versions decide what an episode looks like.
_PACKAGES = ("dm-control", "mujoco", "numpy", "gymnasium-robotics")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """What is asked for; see the flags of `rollout`."""

    domain_name: str
    task_name: str | None
    task_kwargs: Mapping[str, Any]
    policy: str
    num_episodes: int
    seed: int
    output: Path | None
    video: Path | None
    camera: str
    width: int
    height: int
    visualize_reward: bool
    cluster: Cluster | None = None
    video_fps: float = 25.0
    video_episodes: int | None = None


def settings_of_policy(
    file: Path,
    *,
    num_episodes: int,
    seed: int,
    video: Path | None,
    camera: str = "overview",
    video_episodes: int | None = None,
) -> Settings:
    """What plays a trained policy in the task that it was trained for.

    Args:
      file: of the policy.
      num_episodes: how many.
      seed: of the first one.
      video: where to, if anywhere.
      camera: of the video.
      video_episodes: how many of them are filmed; by default all.

    Raises:
      OSError: there is no such file, or it holds nothing of the kind.
      ValueError: its layout is of another version, or its parts do not fit together.
    """
    known = TrainedPolicy.load(file).metadata
    return Settings(
        domain_name=known["domain_name"],
        task_name=known["task_name"],
        task_kwargs=known["task_kwargs"],
        policy=f"trained(file={str(file)!r})",
        num_episodes=num_episodes,
        seed=seed,
        output=None,
        video=video,
        camera=camera,
        width=640,
        height=480,
        visualize_reward=False,
        video_fps=_POLICY_FPS,
        video_episodes=video_episodes,
    )


class RolloutJob:
    """A number of episodes to be played, shown and written."""

    def __init__(self, settings: Settings) -> None:
        """Makes everything ready, so that nothing that can be known to be wrong stops the job later.

        Raises:
          ImportError: there is no ffmpeg, but a video is asked for.
          OSError: the output folder cannot be written to or holds episodes, or the assets are missing.
          TypeError: an argument of the task has the wrong type, or there is no such argument.
          ValueError: an unknown name, or a value that is refused.
        """
        if settings.cluster and settings.video:
            raise ValueError("workers make no video: leave out --workers")
        self._settings = settings
        self._task_name = settings.task_name or suite.default_task(settings.domain_name)
        self._build_policy = policies.find(settings.policy)
        self._environment = self._load()
        self._camera = find_camera(self._environment, settings.camera)
        if settings.video:
            video.check_ffmpeg()
            check_size(self._environment, settings.width, settings.height)
        if settings.output:
            episode_files.claim_folder(settings.output)
        self._last_seed = settings.seed + settings.num_episodes - 1
        self._report = Report(last_seed=self._last_seed)

    @property
    def finished(self) -> int:
        """Number of episodes played to their end, and written."""
        return self._report.count

    @property
    def successes(self) -> int:
        """Number of those that succeeded."""
        return self._report.successes

    def run(self) -> None:
        """Plays all episodes; prints a table, row by row, and a summary, also of what was finished before an error.

        Raises:
          ClusterError: the workers cannot be had, or do not get anywhere.
        """
        settings = self._settings
        _print(f"{settings.domain_name} {self._task_name}, policy {settings.policy}\n")
        try:
            with contextlib.closing(self._environment):
                if settings.cluster:
                    self._play_on(settings.cluster)
                else:
                    self._play_here()
        finally:
            _print(f"\n{self._report.summary()}")

    def _play_here(self) -> None:
        with self._progress() as watch:
            for index, seed in self._episodes():
                self._add(index, play(self._environment, self._build_policy, seed, watch))

    def _play_on(self, cluster: Cluster) -> None:
        settings = self._settings
        build = functools.partial(
            RolloutWorker, settings.domain_name, self._task_name, settings.task_kwargs, settings.policy
        )
        ended = cluster.play(build, self._episodes(), capacity=1, num_threads=1)
        with contextlib.closing(ended), EpisodeBar(settings.num_episodes) as bar:
            for index, episode in ended:
                self._add(index, episode)
                bar.count(bool(episode.outcome.results["success"]))

    def _episodes(self) -> list[tuple[int, int]]:
        """Numbers and seeds."""
        return [(index, self._settings.seed + index) for index in range(self._settings.num_episodes)]

    def _add(self, index: int, episode: Episode) -> None:
        """Writes an episode, and prints its row."""
        self._save(index, episode)
        _print(self._report.add(episode.outcome, index))

    def _load(self) -> Environment:
        settings = self._settings
        # Without a video nobody looks: what only the eye needs would cost time.
        scene = {"visuals": settings.video is not None}
        return suite.load(
            settings.domain_name,
            self._task_name,
            task_kwargs={**settings.task_kwargs, **scene},
            visualize_reward=settings.visualize_reward,
        )

    @contextlib.contextmanager
    def _progress(self) -> Iterator[Callable[[dm_env.TimeStep], None]]:
        """Gives what is to be called at every time step: it moves the bar, and films."""
        limit, left = self._environment.step_limit, self._settings.num_episodes
        with self._open_video() as film, tqdm(total=left * limit, unit="step", disable=None, leave=False) as bar:

            def watch(timestep: dm_env.TimeStep) -> None:
                nonlocal left
                film(timestep)
                bar.update(not timestep.first())
                left -= timestep.last()
                if timestep.last() and bar.total:
                    bar.total = bar.n + left * limit

            yield watch

    @contextlib.contextmanager
    def _open_video(self) -> Iterator[Callable[[dm_env.TimeStep], None]]:
        """Gives what adds the present view to the video; it does nothing where no video is asked for."""
        settings = self._settings
        if settings.video is None:
            yield lambda timestep: None
            return
        size = {"width": settings.width, "height": settings.height}
        # Real time, by as many control steps a frame as it takes to have no more frames than asked for.
        rate = 1.0 / self._environment.control_timestep()
        stride = math.ceil(rate / settings.video_fps - 1e-6)
        with video.open_video(settings.video, **size, frames_per_second=rate / stride) as add:
            steps = episodes = 0

            def film(timestep: dm_env.TimeStep) -> None:
                nonlocal steps, episodes
                episodes, steps = episodes + timestep.first(), 0 if timestep.first() else steps + 1
                if steps % stride == 0 and episodes <= (settings.video_episodes or episodes):
                    add(self._environment.physics.render(**size, camera_id=self._camera))

            yield film

    def _save(self, index: int, episode: Episode) -> None:
        if self._settings.output:
            episode_files.save_episode(self._settings.output, index, episode, self._metadata())

    def _metadata(self) -> dict[str, Any]:
        """What an episode needs besides its seed to be played again."""
        versions = {name: importlib.metadata.version(name) for name in _PACKAGES}
        return {
            "domain_name": self._settings.domain_name,
            "task_name": self._task_name,
            "task_kwargs": dict(self._settings.task_kwargs),
            "policy": self._settings.policy,
            "control_timestep": self._environment.control_timestep(),
            "versions": {"kitchen-suite": kitchen_suite.__version__, **versions},
        }


def describe_suite() -> str:
    """All domains with their tasks and cameras."""
    lines = []
    for domain, tasks in suite.TASKS_BY_DOMAIN.items():
        with contextlib.closing(suite.load(domain, tasks[0], task_kwargs={"visuals": False})) as environment:
            cameras = camera_names(environment)
        lines += [domain, _listing("tasks", tasks), _listing("cameras", cameras)]
    return "\n".join(lines)


def _listing(what: str, names: Sequence[str]) -> str:
    return textwrap.fill(", ".join(names), WIDTH, initial_indent=f"  {what:<9}", subsequent_indent=" " * 11)


def _print(text: str) -> None:
    """Prints above the progress bar, at once: an episode may take long, and the reader may be a pipe."""
    tqdm.write(text)
    sys.stdout.flush()

"""The work of `kitchen-rollout`, and of `kitchen-play` and others that play a trained policy."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import functools
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from dm_control.rl.control import PhysicsError
from tabulate import tabulate
from tqdm import tqdm

from kitchen_suite import files, suite
from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeBuffer, EpisodeStats, Watch, check_file_size
from kitchen_suite.episodes.play import SingleRollout, SingleRunner
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.report import EpisodeBar, Report, print_line
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.episodes.views import Views
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.names import EXACT
from kitchen_suite.policies import PolicyError, load_policy
from kitchen_suite.policies.trained import SHIPPED, shipped_as
from kitchen_suite.rendering import gl, video
from kitchen_suite.rendering.cameras import camera_names
from kitchen_suite.settings import FAILURE, USAGE, WIDTH, PlaySettings, RolloutSettings

if TYPE_CHECKING:
    from kitchen_suite.workers.cluster import RaySettings

# Shows a policy that succeeds, to those who have seen the random one.
_NEXT_COMMAND = "kitchen-rollout --domain_name=open_cabinet --policy=trained"

# What kitchen-play plays and writes without flags.
_DEFAULT_POLICY, _DEFAULT_VIDEO = "top_drawer_grasp", Path("kitchen-play.mp4")


class RolloutJob:
    """Plays a number of episodes, reports and writes them."""

    errors: ClassVar = {PolicyError: USAGE, PhysicsError: FAILURE, OSError: FAILURE}

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
                    with self._watch() as watch:
                        for index, seed in self._episodes:
                            self._add(self._rollout.play(index, seed, watch))
        finally:
            if self.finished:
                print_line(f"\n{self._report.summary()}")
        if self._settings == RolloutSettings():
            print_line(f"\nTry next: {_NEXT_COMMAND}")
        return True

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
        stats = EpisodeStats.of(episode, self._environment.task.records.metrics(episode.last_info))
        if self._folder:
            self._folder.save(episode, stats)
        print_line(self._report.add(stats, episode.index))
        return bool(stats.metrics["success"])

    @contextlib.contextmanager
    def _watch(self) -> Iterator[Watch]:
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


def policy_rollout(file: Path, **settings: Any) -> RolloutSettings:
    """Returns settings, some of them given, that play a trained policy in the task that it was trained for."""
    trained_for = load_policy(file).metadata
    return RolloutSettings(
        domain_name=trained_for["domain_name"],
        task_name=trained_for["task_name"],
        task_kwargs=trained_for["task_kwargs"],
        policy=f"trained(file={str(file)!r})",
        **settings,
    )


class PlayJob(RolloutJob):
    """Plays and films a trained policy."""

    def __init__(self, settings: PlaySettings) -> None:
        if settings.shipped and settings.policy_file:
            raise ValueError("--shipped and --policy_file both name a policy: give one of them")
        if settings.video and settings.novideo:
            raise ValueError("--video and --novideo contradict each other: give one of them")
        is_default = not (settings.video or settings.novideo or settings.web)
        self._reason_against_video = _reason_against_video() if is_default else ""
        self._video = _DEFAULT_VIDEO if is_default and not self._reason_against_video else settings.video
        file = settings.policy_file or shipped_as(settings.shipped or _DEFAULT_POLICY)
        of_rollout = {field.name for field in dataclasses.fields(RolloutSettings)}
        shared = {name: value for name, value in vars(settings).items() if name in of_rollout}
        super().__init__(policy_rollout(file, **{**shared, "video": self._video}))

    def run(self) -> bool:
        super().run()
        if self._video:
            print_line(f"video {self._video}")
        if self._reason_against_video:
            print_line(f"no video: {self._reason_against_video}")
        return True


def _shipped_policies() -> Iterator[str]:
    yield tabulate([_row(path) for path in sorted(SHIPPED.glob("*.npz"))], headers="keys")


def _row(path: Path) -> dict[str, str]:
    """Returns task, physics, success in the evaluation that chose it, networks and file size of a policy, by column."""
    policy = load_policy(path)
    metadata = policy.metadata
    evaluated = metadata["task_kwargs"].get("physics", EXACT)
    return {
        "--shipped": path.stem,
        "task": f"{metadata['domain_name']} {metadata['task_name']}",
        "trained in": (metadata.get("training_kwargs") or {}).get("physics", evaluated),
        "success": f"{metadata['training']['success']:.0%} in {evaluated}",
        "layers": " ".join(str(size) for size in policy.layers),
        "size": f"{path.stat().st_size / 1024:.0f} KiB",
    }


def _reason_against_video() -> str:
    """Returns why the default video cannot be made here; empty if it can."""
    try:
        gl.find_library()
        video.check_ffmpeg()
        files.check_writable(_DEFAULT_VIDEO.parent)
        if _DEFAULT_VIDEO.is_dir():
            raise IsADirectoryError(f"{_DEFAULT_VIDEO} is a folder")
    except (ImportError, OSError) as error:
        return str(error)
    return ""


class ListJob:
    """Prints the lines of a list as they are made."""

    errors: ClassVar = {OSError: FAILURE}

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = lines

    def progress(self) -> str:
        return "while listing"

    def run(self) -> bool:
        for line in self._lines:
            print_line(line)
        return True


def make_job(settings: RolloutSettings | PlaySettings) -> RolloutJob | ListJob:
    """Returns the job that settings ask for."""
    if isinstance(settings, PlaySettings):
        return ListJob(_shipped_policies()) if settings.list else PlayJob(settings)
    return ListJob(_domains()) if settings.list else RolloutJob(settings)


def _domains() -> Iterator[str]:
    for domain, tasks in suite.TASKS_BY_DOMAIN.items():
        with contextlib.closing(suite.load(domain, tasks[0], task_kwargs={"visuals": False})) as environment:
            names = camera_names(environment.physics)
        yield "\n".join((domain, _listing("tasks", tasks), _listing("cameras", names)))


def _listing(title: str, names: Sequence[str]) -> str:
    return textwrap.fill(", ".join(names), WIDTH, initial_indent=f"  {title:<9}", subsequent_indent=" " * 11)

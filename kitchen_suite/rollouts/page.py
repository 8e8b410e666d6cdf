"""Web pages of episodes that are played in single environments."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from kitchen_suite import files
from kitchen_suite.environment import Environment
from kitchen_suite.rendering import cameras, viser_servers
from kitchen_suite.rendering.web_page import WebPage
from kitchen_suite.rendering.web_scenes import SceneRecorder
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.settings import PageSettings

# Seconds that the end of an episode is shown before its player begins again.
_LAST_FRAME = 1.0

PageStep = Callable[[EpisodeBuffer, Environment], None]


class Page:
    """Records the first episodes of a command for a web page; does nothing where none is asked for."""

    def __init__(self, settings: PageSettings, *, num_episodes: int) -> None:
        """Checks that the page can be made.

        Args:
          settings: of the page.
          num_episodes: maximum number of episodes in the page.

        Raises:
          ImportError: the extra is missing.
        """
        if settings.web:
            viser_servers.check_extra("a web page")
        self._settings, self._num_episodes = settings, num_episodes

    @contextlib.contextmanager
    def open(self) -> Iterator[PageStep]:
        """Yields a function that adds the present step of an environment; in the end the page is written.

        An exception, such as an interrupt, ends the page early: the steps until then are kept.

        Raises:
          OSError: the page cannot be written.
        """
        path = self._settings.web
        if path is None:
            yield lambda buffer, environment: None
            return
        with SceneRecorder() as recorder:
            writer = _Writer(recorder, self._settings.camera, self._num_episodes)
            try:
                yield writer.add
            except BaseException:
                writer.end_episode()
                if writer.page:
                    writer.write(path)
                    print_line(f"web page {path} ends early, in episode {len(writer.page)}")
                raise
            writer.end_episode()
        if writer.page:
            writer.write(path)
            print_line(f"web page {path}, {path.stat().st_size / 1e6:.1f} MB")


class _Writer:
    """Collects the episodes of a page."""

    def __init__(self, recorder: SceneRecorder, camera: str, num_episodes: int) -> None:
        self.page, self._title = WebPage(), ""
        self._recorder, self._camera, self._num_episodes = recorder, camera, num_episodes
        self._about: dict[str, Any] | None = None

    def add(self, buffer: EpisodeBuffer, environment: Environment) -> None:
        """Adds the present step, of the episode in progress or of a new one."""
        if buffer.steps == 0:
            self.end_episode()
            if len(self.page) < self._num_episodes:
                self._begin(buffer, environment)
        elif self._about:
            self._recorder.add_frame(environment.physics, environment.control_timestep())
        if self._about:
            _add_progress(self._about, buffer.reward, environment)
            if buffer.has_ended:
                self.end_episode()

    def _begin(self, buffer: EpisodeBuffer, environment: Environment) -> None:
        physics, task = environment.physics, environment.task
        self._recorder.start(physics, cameras.find_camera(physics, self._camera))
        self._about = {
            "name": buffer.name or f"episode {len(self.page)}",
            "instruction": task.instruction,
            "timestep": environment.control_timestep(),
            "rewards": [],
            "returns": [],
            "tasks": [],
            "metrics": {},
        }

    def end_episode(self) -> None:
        """Adds the episode in progress, if there is one, to the page."""
        about, self._about = self._about, None
        if about:
            self.page.add(self._recorder.finish(_LAST_FRAME), about)

    def write(self, path: Path) -> None:
        """Writes the page."""
        with files.atomic_write(path) as partial:
            partial.write_text(self.page.html(path.stem), encoding="utf-8")


def _add_progress(about: dict[str, Any], reward: float, environment: Environment) -> None:
    """Adds the progress after a step: reward, return, tasks with the control steps of their completion, measures."""
    task = environment.task
    about["returns"].append(reward + (about["returns"] or [0.0])[-1])
    about["rewards"].append(reward)
    if completions := task.episode_completions:
        about["tasks"] = [*completions.steps_by_task.items()]
    for name, value in task.episode_metrics.items():
        if not isinstance(value, dict):
            about["metrics"].setdefault(name, []).append(value)

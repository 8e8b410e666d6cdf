"""Films and web pages of episodes that are played in single environments."""

import contextlib
import functools
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import EpisodeBuffer, Watch
from kitchen_suite.episodes.report import counted, print_line
from kitchen_suite.rendering import cameras, video, viser_servers
from kitchen_suite.rendering.web_page import WebPage
from kitchen_suite.rendering.web_scenes import SceneRecorder
from kitchen_suite.settings import FilmSettings, PageSettings

PageStep = Callable[[EpisodeBuffer, Environment], None]


class Page:
    """Records the first episodes of a command for a web page; does nothing where none is asked for."""

    def __init__(self, settings: PageSettings, *, num_episodes: int) -> None:
        """Checks that the page, of `num_episodes` at most, can be made."""
        if settings.web:
            viser_servers.check_extra("a web page")
        self._settings, self._num_episodes = settings, num_episodes
        self._page, self._about = WebPage(), dict[str, Any]()

    @contextlib.contextmanager
    def open(self) -> Iterator[PageStep]:
        """Yields a function that adds the present step of an environment; in the end the page is written.

        An exception, such as an interrupt, ends the page early: the steps until then are kept.
        """
        path, page, is_complete = self._settings.web, self._page, False
        if path is None:
            yield lambda buffer, environment: None
            return
        with SceneRecorder() as recorder:
            try:
                yield functools.partial(self._add, recorder)
                is_complete = True
            finally:
                self._end_episode(recorder)
                if page:
                    with files.atomic_write(path) as partial:
                        partial.write_text(page.html(path.stem), encoding="utf-8")
                    size = path.stat().st_size / 1e6
                    end = f", {size:.1f} MB" if is_complete else f" ends early, in episode {len(page)}"
                    print_line(f"web page {path}{end}")

    def _add(self, recorder: SceneRecorder, buffer: EpisodeBuffer, environment: Environment) -> None:
        """Adds a step: its frame, reward and return, tasks with the control steps of their completion, measures."""
        physics, timestep = environment.physics, environment.control_timestep()
        if buffer.steps == 0:
            self._end_episode(recorder)
            if len(self._page) < self._num_episodes:
                recorder.start(physics, cameras.find_camera(physics, self._settings.camera))
                name, instruction = buffer.name or f"episode {len(self._page)}", environment.task.instruction
                self._about = {"name": name, "instruction": instruction, "timestep": timestep}
                self._about |= {"rewards": [], "returns": [], "tasks": [], "metrics": {}}
        elif self._about:
            recorder.add_frame(physics, timestep)
        if about := self._about:
            task = environment.task
            about["returns"].append(buffer.reward + (about["returns"] or [0.0])[-1])
            about["rewards"].append(buffer.reward)
            if completions := task.episode_completions:
                about["tasks"] = [*completions.steps_by_task.items()]
            for name, value in task.episode_metrics.items():
                if not isinstance(value, dict):
                    about["metrics"].setdefault(name, []).append(value)
            if buffer.has_ended:
                self._end_episode(recorder)

    def _end_episode(self, recorder: SceneRecorder) -> None:
        about, self._about = self._about, {}
        if about:
            # The end is shown for a second before the player begins again.
            self._page.add(recorder.finish(1.0), about)


class Views:
    """Films the first episodes of a command in real time, and makes a web page of them, each if it is asked for."""

    def __init__(
        self, settings: FilmSettings, environment: Environment, *, num_episodes: int, max_steps: int | None
    ) -> None:
        """Checks that film and page of some episodes can be made; None as `max_steps` stands for no limit."""
        self._settings, self._environment = settings, environment
        self._camera = cameras.find_camera(environment.physics, settings.camera)
        if settings.video:
            video.check_ffmpeg()
            cameras.check_size(environment.physics, settings.width, settings.height)
        rate = 1.0 / environment.control_timestep()
        # Control steps for each frame.
        self._stride = max(1, math.ceil(rate / settings.video_fps - 1e-6))
        self._frames_per_second = rate / self._stride
        self._num_episodes = min(settings.video_episodes, num_episodes)
        self._max_frames = None if max_steps is None else self._num_episodes * (max_steps // self._stride + 1)
        self._page = Page(settings, num_episodes=settings.web_episodes)

    @contextlib.contextmanager
    def open(self) -> Iterator[Watch]:
        with self._open_film() as film_step, self._page.open() as page_step:

            def show(buffer: EpisodeBuffer) -> None:
                film_step(buffer)
                page_step(buffer, self._environment)

            yield show

    @contextlib.contextmanager
    def _open_film(self) -> Iterator[Watch]:
        """Yields a function that films the present step; reports how long the film will take."""
        settings, episodes = self._settings, 0
        if settings.video is None:
            yield lambda buffer: None
            return
        self._announce()
        with video.open_video(
            settings.video,
            width=settings.width,
            height=settings.height,
            frames_per_second=self._frames_per_second,
            on_partial=lambda frames: print_line(f"video {settings.video} ends early, after {frames} frames"),
        ) as add_frame:

            def film(buffer: EpisodeBuffer) -> None:
                nonlocal episodes
                episodes += buffer.steps == 0
                if buffer.steps % self._stride == 0 and episodes <= self._num_episodes:
                    add_frame(self._render())

            yield film

    def _announce(self) -> None:
        """Prints how much there is to film, and how long it takes by the time of one frame."""
        self._render()  # The first frame takes longer: it makes the GL context.
        started = time.perf_counter()
        self._render()
        seconds = time.perf_counter() - started
        extent = f", about {seconds:.2f} s a frame"
        if self._max_frames is not None:
            extent = f": at most {self._max_frames} frames, about {self._max_frames * seconds:.0f} s"
        print_line(f"filming {counted(self._num_episodes)}{extent}\n")

    def _render(self) -> NDArray[np.uint8]:
        settings = self._settings
        return self._environment.physics.render(settings.height, settings.width, camera_id=self._camera)

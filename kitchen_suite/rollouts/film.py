"""Films of episodes that are played in a single environment."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.rendering import cameras, video
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.page import Page
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.settings import FilmSettings


class Film:
    """Films the first episodes of a command in real time; does nothing where no video is asked for."""

    def __init__(
        self, settings: FilmSettings, environment: Environment, *, num_episodes: int, max_steps: int | None
    ) -> None:
        """Checks that the film can be made.

        Args:
          settings: of the film.
          environment: that is filmed.
          num_episodes: number of episodes that will be played.
          max_steps: maximum number of control steps in an episode; None where there is none.

        Raises:
          ImportError: a film is asked for, but there is no ffmpeg.
          ValueError: there is no such camera, or the pictures are too large.
        """
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

    @contextlib.contextmanager
    def open(self) -> Iterator[Callable[[EpisodeBuffer], None]]:
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
        episodes = f"{self._num_episodes} episode" + ("s" if self._num_episodes > 1 else "")
        if self._max_frames is None:
            print_line(f"filming {episodes}, about {seconds:.2f} s a frame\n")
        else:
            total = self._max_frames * seconds
            print_line(f"filming {episodes}: at most {self._max_frames} frames, about {total:.0f} s\n")

    def _render(self) -> NDArray[np.uint8]:
        settings = self._settings
        return self._environment.physics.render(settings.height, settings.width, camera_id=self._camera)


class Views:
    """The film and the web page of a command, each if it is asked for."""

    def __init__(
        self, settings: FilmSettings, environment: Environment, *, num_episodes: int, max_steps: int | None
    ) -> None:
        """Checks that they can be made; arguments are those of `Film`.

        Raises:
          ImportError: an extra is missing.
          ValueError: there is no such camera, or the pictures are too large.
        """
        self._environment = environment
        self._film = Film(settings, environment, num_episodes=num_episodes, max_steps=max_steps)
        self._page = Page(settings, num_episodes=settings.web_episodes)

    @contextlib.contextmanager
    def open(self) -> Iterator[Callable[[EpisodeBuffer], None]]:
        """Yields a function that shows the present step."""
        with self._film.open() as film_step, self._page.open() as page_step:

            def show(buffer: EpisodeBuffer) -> None:
                film_step(buffer)
                page_step(buffer, self._environment)

            yield show

"""Videos of episodes, as mp4 files; needs the extra `video`."""

import contextlib
import importlib.util
import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, installation
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import EpisodeBuffer, Summary, Watch
from kitchen_suite.episodes.play import SingleRollout
from kitchen_suite.episodes.report import counted
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef
from kitchen_suite.rendering import cameras


def check_ffmpeg() -> None:
    """Raises an ImportError unless imageio-ffmpeg, and the ffmpeg binary that comes with it, can write videos."""
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ImportError(f"a video needs imageio-ffmpeg: {installation.install_command('video')}")
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise ImportError(f"a video needs ffmpeg: {error}") from error


@contextlib.contextmanager
def open_video(
    path: Path,
    *,
    width: int,
    height: int,
    frames_per_second: float,
    on_partial: Callable[[int], object] = lambda frames: None,
) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """Yields a function that appends a frame, uint8 `(height, width, 3)`, to a video; both are even.

    An existing mp4 file is replaced. An exception, such as an interrupt, ends the video early: the frames until then
    are kept, and `on_partial` is called with their number. An OSError means that ffmpeg failed, or the disk is full.
    """
    import imageio_ffmpeg  # Only installed with the extra.

    early_end, count = None, 0
    with files.atomic_write(path) as partial:
        # Absolute: ffmpeg takes a relative name with a colon for a protocol.
        name, settings = str(partial.absolute()), {"macro_block_size": 2, "ffmpeg_log_level": "quiet"}
        ffmpeg = imageio_ffmpeg.write_frames(name, (width, height), fps=frames_per_second, quality=7, **settings)

        def send(frame: NDArray[np.uint8]) -> None:
            nonlocal count
            ffmpeg.send(frame)
            count += 1

        # A thread of its own: an interrupt while a frame is written would end ffmpeg before the file is complete.
        with contextlib.closing(ffmpeg), ThreadPoolExecutor(1) as thread:
            ffmpeg.send(None)
            try:
                yield lambda frame: thread.submit(send, np.ascontiguousarray(frame)).result()
            except BaseException as error:
                if not count:
                    raise
                early_end = error
        _check_frame_count(name, count)
    if early_end is not None:
        on_partial(count)
        raise early_end


def _check_frame_count(path: str, expected: int) -> None:
    """Raises an OSError if a video has not all its frames; imageio-ffmpeg ignores ffmpeg's exit status."""
    import imageio_ffmpeg

    try:
        found, _ = imageio_ffmpeg.count_frames_and_secs(path)
    except RuntimeError:
        found = 0
    if found != expected:
        raise OSError(f"ffmpeg wrote {found} of {expected} frames")


def frame_stride(control_timestep: float, frames_per_second: float) -> tuple[int, float]:
    """Returns the control steps for each frame of a video in real time, and its frames per second, at most those given.

    `control_timestep` is the length of a control step [s].
    """
    rate = 1.0 / control_timestep
    stride = max(1, math.ceil(rate / frames_per_second - 1e-6))
    return stride, rate / stride


class EpisodeVideo:
    """A video of the first episodes that an environment plays, in real time."""

    def __init__(
        self,
        path: Path,
        environment: Environment,
        *,
        camera: str,
        width: int,
        height: int,
        frames_per_second: float,
        num_episodes: int,
        max_steps: int | None,
        report: Callable[[str], object] = lambda text: None,
    ) -> None:
        """Checks that the video can be made.

        Args:
          path: file to write; an existing one is replaced.
          environment: that plays the episodes.
          camera: name of a camera of its model.
          width: of a frame [pixels], even.
          height: of a frame [pixels], even.
          frames_per_second: at most; there is at most one frame for each control step.
          num_episodes: number of episodes to film.
          max_steps: control steps of an episode at most; None for no limit.
          report: is called with how long the video will take, and where it ends early.
        """
        check_ffmpeg()
        cameras.check_size(environment.physics, width, height)
        self._path = path
        self._report = report
        self._environment = environment
        self._camera = cameras.find_camera(environment.physics, camera)
        self._width, self._height = width, height
        self._stride, self._frames_per_second = frame_stride(environment.control_timestep(), frames_per_second)
        self._num_episodes = num_episodes
        self._max_frames = None if max_steps is None else num_episodes * (max_steps // self._stride + 1)

    @contextlib.contextmanager
    def open(self) -> Iterator[Watch]:
        """Yields a function that films the current step; reports how long the video will take."""
        self._announce()
        episodes = 0
        with open_video(
            self._path,
            width=self._width,
            height=self._height,
            frames_per_second=self._frames_per_second,
            on_partial=lambda frames: self._report(f"video {self._path} ends early, after {frames} frames"),
        ) as add_frame:

            def film(buffer: EpisodeBuffer, environment: Environment) -> None:
                nonlocal episodes
                episodes += buffer.steps == 0
                if buffer.steps % self._stride == 0 and episodes <= self._num_episodes:
                    add_frame(self._render(environment))

            yield film

    def _announce(self) -> None:
        """Reports how much there is to film, and how long it takes by the time of one frame."""
        self._render(self._environment)  # The first frame takes longer: it makes the GL context.
        started = time.perf_counter()
        self._render(self._environment)
        seconds = time.perf_counter() - started
        extent = f", about {seconds:.2f} s a frame"
        if self._max_frames is not None:
            extent = f": at most {self._max_frames} frames, about {self._max_frames * seconds:.0f} s"
        self._report(f"filming {counted(self._num_episodes)}{extent}\n")

    def _render(self, environment: Environment) -> NDArray[np.uint8]:
        return environment.physics.render(self._height, self._width, camera_id=self._camera)


def film(
    path: Path,
    spec: EpisodeSpec,
    policy: PolicyRef,
    *,
    camera: str = "overview",
    width: int = 640,
    height: int = 480,
    frames_per_second: float = 12.5,
    render_quality: str = "fast",
) -> Summary:
    """Plays the episode of a specification's seed in this process, and films it.

    Args:
      path: mp4 file to write; an existing one is replaced.
      spec: of the episode.
      policy: that acts.
      camera: name of a camera of the scene.
      width: of a frame [pixels], even.
      height: of a frame [pixels], even.
      frames_per_second: at most; there is at most one frame for each control step. The default is enough to follow a
        motion, and few enough to be rendered without a graphics card.
      render_quality: `high` or `fast`.

    Returns the summary of the episode.
    """
    build = policy.sequential_builder(spec.policy_sha256)
    rollout = SingleRollout(spec, build, visuals=True, render_quality=render_quality)
    with contextlib.closing(rollout.environment):
        spec.check_policy(policy, rollout.environment)
        video = EpisodeVideo(
            path,
            suite_env(rollout.environment).environment,
            camera=camera,
            width=width,
            height=height,
            frames_per_second=frames_per_second,
            num_episodes=1,
            max_steps=spec.max_episode_steps,
        )
        with video.open() as watch:
            return rollout.play(0, spec.seed, watch).summary

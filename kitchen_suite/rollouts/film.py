"""Films of episodes that are played in a single environment."""

import contextlib
import math
from collections.abc import Callable, Iterator

from kitchen_suite.environment import Environment
from kitchen_suite.rendering import cameras, video
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.settings import FilmSettings


def check(settings: FilmSettings, environment: Environment) -> int:
    """Returns the number of the camera, if a film can be made of an environment that has been reset.

    Raises:
      ImportError: a film is asked for, but there is no ffmpeg.
      ValueError: there is no such camera, or the pictures are too large.
    """
    camera = cameras.find_camera(environment.physics, settings.camera)
    if settings.video:
        video.check_ffmpeg()
        cameras.check_size(environment.physics, settings.width, settings.height)
    return camera


@contextlib.contextmanager
def open_film(
    settings: FilmSettings, environment: Environment, max_episodes: int | None = None
) -> Iterator[Callable[[EpisodeBuffer], None]]:
    """Yields a function that films the present step, and does nothing where no video is asked for.

    The film plays in real time, with as many control steps for a frame as `video_fps` needs.

    Args:
      settings: of the film.
      environment: that is filmed.
      max_episodes: number of episodes in the film, the first ones; all when omitted.
    """
    if settings.video is None:
        yield lambda buffer: None
        return
    camera, size = check(settings, environment), {"width": settings.width, "height": settings.height}
    rate = 1.0 / environment.control_timestep()
    stride = max(1, math.ceil(rate / settings.video_fps - 1e-6))
    episodes = 0
    with video.open_video(settings.video, **size, frames_per_second=rate / stride) as add_frame:

        def film(buffer: EpisodeBuffer) -> None:
            nonlocal episodes
            episodes += buffer.steps == 0
            if buffer.steps % stride == 0 and episodes <= (max_episodes or episodes):
                add_frame(environment.physics.render(**size, camera_id=camera))

        yield film

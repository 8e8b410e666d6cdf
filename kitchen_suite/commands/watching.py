"""The video and the web page that commands make of the episodes that they play."""

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from absl.flags import FlagValues
from tqdm import tqdm

from kitchen_suite import installation

if TYPE_CHECKING:
    from kitchen_suite.environment import Environment
    from kitchen_suite.episodes.episode import EpisodeBuffer, Watch


@contextlib.contextmanager
def watching(given: FlagValues, environment: "Environment", *, num_episodes: int, max_steps: int) -> "Iterator[Watch]":
    """Yields a function that shows steps in a progress bar, and films them or adds them to a web page if wanted.

    Args:
      given: flags of `flags.page` and `flags.video`, for which `check` raised nothing.
      environment: that plays the episodes.
      num_episodes: number of episodes that will be played.
      max_steps: control steps of an episode at most.
    """
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.episodes.video import EpisodeVideo

    watches: list[Watch] = []
    with contextlib.ExitStack() as stack:
        if given.video:
            video = EpisodeVideo(
                given.video,
                environment,
                camera=given.camera,
                width=given.width,
                height=given.height,
                frames_per_second=given.video_fps,
                num_episodes=min(given.video_episodes, num_episodes),
                max_steps=max_steps,
                report=print_line,
            )
            watches.append(stack.enter_context(video.open()))
        if given.web:
            watches.append(stack.enter_context(page(given, given.web_episodes)))

        left = num_episodes * max_steps
        bar = stack.enter_context(tqdm(total=left, unit="step", disable=None, leave=False))

        def watch(buffer: "EpisodeBuffer", environment: "Environment") -> None:
            for each in watches:
                each(buffer, environment)
            bar.update(buffer.steps > 0)
            if buffer.has_ended:
                nonlocal left
                # An episode may be shorter.
                left -= max_steps - buffer.steps
                bar.total = left

        yield watch


def check(given: FlagValues, environment: "Environment") -> None:
    """Raises an ImportError or a ValueError if video or page cannot be made of what an environment plays."""
    from kitchen_suite.episodes.video import check_ffmpeg
    from kitchen_suite.rendering import cameras

    check_page(given)
    cameras.find_camera(environment.physics, given.camera)
    if given.video:
        check_ffmpeg()
        cameras.check_size(environment.physics, given.width, given.height)


def check_page(given: FlagValues) -> None:
    """Raises an ImportError if a web page is wanted that cannot be made here."""
    if given.web:
        installation.installed(("viser", "mjviser"), "a web page", "web")


def page(given: FlagValues, num_episodes: int | None) -> "contextlib.AbstractContextManager[Watch]":
    """Returns a context of the function that adds steps to the web page, which is written in the end."""
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.viewer.episode_page import EpisodePage

    return EpisodePage(given.web, camera=given.camera, num_episodes=num_episodes, report=print_line).open()


def rendering(given: FlagValues) -> dict[str, Any]:
    """Returns the arguments of a watched environment; without images it is built without visuals, and steps faster."""
    return {"visuals": True if given.video or given.web else None, "render_quality": given.render_quality}

"""Videos of two policies in the same episodes, side by side; needs the extra `video`."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path

import numpy as np
from dm_control.rl.control import PhysicsError
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.episodes.episode import EpisodeBuffer
from kitchen_suite.episodes.play import episode_name
from kitchen_suite.episodes.replay import replayed_steps
from kitchen_suite.episodes.video import frame_stride, open_video
from kitchen_suite.evaluation.compare import PairedComparison
from kitchen_suite.evaluation.paired_scores import Pair
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.sides import Side
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import OF_OBSERVATIONS
from kitchen_suite.rendering import cameras

# Time for which the end of both episodes is shown [s].
_END = 1.0

# Height of the captions as a fraction of the video's.
_CAPTION = 0.05

Step = tuple[EpisodeBuffer, Environment]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Picture:
    """How episodes are filmed.

    Attributes:
      camera: name of a camera.
      width: of the whole picture, both episodes together [pixels], even.
      height: of the picture [pixels], even.
      frames_per_second: at most.
      render_quality: `high` or `fast`.
    """

    camera: str = "overview"
    width: int = 1280
    height: int = 480
    frames_per_second: float = 25.0
    render_quality: str = "fast"


def check_replays(comparison: PairedComparison) -> None:
    """Raises a ValueError unless the actions of both policies were kept."""
    for each in (comparison.first, comparison.second):
        if each.recorded is None:
            raise ValueError(f"{each.name} has no actions to play again: write a receipt, and compare that")


def replayed(played: Side, result: EpisodeResult, render_quality: str = "fast") -> Generator[Step, None, None]:
    """Plays the actions of an episode again; yields it with its environment after the reset and after every step."""
    assert played.recorded
    spec = played.specs[result.condition].without(OF_OBSERVATIONS)
    with contextlib.closing(spec.make_environment(visuals=True, render_quality=render_quality)) as environment:
        # Builds the task, of which the options of a reset depend.
        environment.reset()
        options, actions = played.recorded(suite_env(environment).composer_task, result)
        name = f"{played.name}, {episode_name(result.episode, result.seed)}"
        # An episode is shown until its physics diverges.
        with contextlib.suppress(PhysicsError):
            yield from replayed_steps(environment, result.seed, spec.seeding, options, actions, name)


def film(comparison: PairedComparison, path: Path, picture: Picture, num_episodes: int) -> int:
    """Films the first episodes in which one policy alone succeeds; returns how many there are to film.

    The first policy is on the left. An existing file is replaced; without such episodes none is written.
    """
    check_replays(comparison)
    chosen = comparison.differing[:num_episodes]
    if not chosen:
        return 0
    spec = comparison.first.specs[chosen[0][0].condition]
    with contextlib.closing(spec.make_environment(visuals=True)) as environment:
        physics = suite_env(environment).environment.physics
        cameras.find_camera(physics, picture.camera)
        cameras.check_size(physics, picture.width // 2, picture.height)
        stride, rate = frame_stride(suite_env(environment).environment.control_timestep(), picture.frames_per_second)
    with open_video(path, width=picture.width, height=picture.height, frames_per_second=rate) as add_frame:
        for pair in chosen:
            for frame in frames(comparison, pair, picture, stride):
                last = frame
                add_frame(frame)
            for _ in range(round(_END * rate)):
                add_frame(last)
    return len(chosen)


def frames(comparison: PairedComparison, pair: Pair, picture: Picture, stride: int = 1) -> Iterator[NDArray[np.uint8]]:
    """Yields the frames `(height, width, 3)` of an episode of both policies, with their names.

    There is a frame for every `stride` control steps. The episode that ends first stands still until the other one has
    ended.
    """
    played = (comparison.first, comparison.second)
    shown = [np.zeros((picture.height, picture.width // 2, 3), np.uint8)] * 2
    with contextlib.ExitStack() as stack:
        halves = [_half(each, result, picture, stride) for each, result in zip(played, pair, strict=True)]
        for half in halves:
            stack.enter_context(contextlib.closing(half))
        for both in itertools.zip_longest(*halves):
            shown = [old if new is None else new for new, old in zip(both, shown, strict=True)]
            yield np.concatenate(shown, axis=1)


def _half(
    played: Side, result: EpisodeResult, picture: Picture, stride: int
) -> Generator[NDArray[np.uint8], None, None]:
    """Yields the frames of one policy's episode; the last one, at its end, says whether it succeeded."""
    for buffer, environment in replayed(played, result, picture.render_quality):
        has_ended = buffer.steps == result.control_steps
        if buffer.steps % stride == 0 or has_ended:
            physics = environment.physics
            camera = cameras.find_camera(physics, picture.camera)
            image = physics.render(picture.height, picture.width // 2, camera_id=camera)
            end = f": {'success' if result.success else 'failure'}, {result.control_steps} steps" if has_ended else ""
            yield _captioned(image, f"{played.name}{end}", f"seed {result.seed}")


def _captioned(image: NDArray[np.uint8], above: str, below: str) -> NDArray[np.uint8]:
    """Returns an image with a line of text at its top and another at its bottom."""
    from PIL import Image, ImageDraw, ImageFont  # Needed for videos alone.

    picture = Image.fromarray(image)
    draw = ImageDraw.Draw(picture, "RGBA")
    width, height = picture.size
    bar = round(_CAPTION * height) + 4
    font = ImageFont.load_default(size=_CAPTION * height)
    for top, text in ((0, above), (height - bar, below)):
        draw.rectangle((0, top, width, top + bar), fill=(0, 0, 0, 160))
        draw.text((bar // 3, top), text, font=font, fill=(255, 255, 255, 255))
    return np.asarray(picture)


def add_to_page(
    comparison: PairedComparison, add: Callable[[str, Iterable[tuple[Step, Step]]], None], num_episodes: int
) -> int:
    """Plays the first episodes in which one policy alone succeeds, of both at once; returns how many there are.

    `add` is called with the name of each and the steps of both, such as that of a web page.
    """
    check_replays(comparison)
    chosen = comparison.differing[:num_episodes]
    for pair in chosen:
        result = pair[0]
        condition = f"{result.condition}, " if len(comparison.pairs) > 1 else ""
        add(f"{condition}{episode_name(result.episode, result.seed)}", _both(comparison, pair))
    return len(chosen)


def _both(comparison: PairedComparison, pair: Pair) -> Iterator[tuple[Step, Step]]:
    """Yields the steps of an episode of both policies; of that which ends first, the last one again."""
    played = (comparison.first, comparison.second)
    first, second = (replayed(each, result) for each, result in zip(played, pair, strict=True))
    with contextlib.closing(first), contextlib.closing(second):
        one, other = next(first), next(second)
        yield one, other
        for following, other_following in itertools.zip_longest(first, second):
            one, other = following or one, other_following or other
            yield one, other

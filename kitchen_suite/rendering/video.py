"""Videos as mp4 files, by the extra `video`."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.files import whole_file


def check_ffmpeg() -> None:
    """Sees to it that videos can be written.

    Raises:
      ImportError: imageio-ffmpeg, or the program that comes with it, is missing.
    """
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ImportError("a video needs imageio-ffmpeg: pip install 'kitchen-suite[video]'")
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise ImportError(f"a video needs ffmpeg: {error}") from error


@contextlib.contextmanager
def open_video(
    path: Path, *, width: int, height: int, frames_per_second: float
) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """Gives a function that adds a frame, `(height, width, 3)`, to an mp4.

    Args:
      path: the video; one that is there already is replaced.
      width: an even number of pixels.
      height: an even number of pixels.
      frames_per_second: how fast it plays.

    Raises:
      OSError: ffmpeg failed.
    """
    import imageio_ffmpeg  # An extra of the package: only who writes a video needs it.

    frames = 0
    with whole_file(path) as partial:
        writer = imageio_ffmpeg.write_frames(
            str(partial),
            (width, height),
            fps=frames_per_second,
            quality=7,
            macro_block_size=2,
            ffmpeg_log_level="fatal",
        )

        def add(frame: NDArray[np.uint8]) -> None:
            nonlocal frames
            writer.send(np.ascontiguousarray(frame))
            frames += 1

        with contextlib.closing(writer):
            writer.send(None)
            yield add
        _check_frames(partial, frames)


def _check_frames(path: Path, expected: int) -> None:
    """Raises an OSError if a video is not whole; ffmpeg's own verdict is lost on the way."""
    import imageio_ffmpeg

    try:
        found, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError as error:
        raise OSError(f"ffmpeg failed: {error}") from error
    if found != expected:
        raise OSError(f"ffmpeg wrote {found} of {expected} frames")

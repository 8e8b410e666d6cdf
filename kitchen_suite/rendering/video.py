"""Videos as mp4 files; needs the extra `video`."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.files import atomic_write


def check_ffmpeg() -> None:
    """Checks that videos can be written.

    Raises:
      ImportError: imageio-ffmpeg, or the ffmpeg binary that comes with it, is missing.
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
    """Yields a function that appends a frame, uint8 `(height, width, 3)`, to a video.

    Args:
      path: an mp4 file; an existing one is replaced.
      width: an even number of pixels.
      height: an even number of pixels.
      frames_per_second: playback rate.

    Raises:
      OSError: ffmpeg failed.
    """
    with atomic_write(path) as partial:
        with contextlib.closing(_VideoWriter(partial, (width, height), frames_per_second)) as writer:
            yield writer.append
        _check_frame_count(partial, writer.frame_count)


class _VideoWriter:
    """Sends frames to an ffmpeg process and counts them."""

    def __init__(self, path: Path, size: tuple[int, int], frames_per_second: float) -> None:
        import imageio_ffmpeg  # Only installed with the extra.

        self.frame_count = 0
        self._ffmpeg = imageio_ffmpeg.write_frames(
            str(path), size, fps=frames_per_second, quality=7, macro_block_size=2, ffmpeg_log_level="fatal"
        )
        self._ffmpeg.send(None)

    def append(self, frame: NDArray[np.uint8]) -> None:
        """Appends a frame."""
        self._ffmpeg.send(np.ascontiguousarray(frame))
        self.frame_count += 1

    def close(self) -> None:
        """Ends the ffmpeg process, which completes the file."""
        self._ffmpeg.close()


def _check_frame_count(path: Path, expected: int) -> None:
    """Raises an OSError if a video has not all its frames; imageio-ffmpeg ignores ffmpeg's exit status."""
    import imageio_ffmpeg

    try:
        found, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError as error:
        raise OSError(f"ffmpeg failed: {error}") from error
    if found != expected:
        raise OSError(f"ffmpeg wrote {found} of {expected} frames")

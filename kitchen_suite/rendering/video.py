"""Videos as mp4 files; needs the extra `video`."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, files

_PROBE = 2**20  # Bytes that a disk cannot take where it was too full for ffmpeg, which does not report it.


def check_ffmpeg() -> None:
    """Raises an ImportError unless imageio-ffmpeg, and the ffmpeg binary that comes with it, can write videos."""
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ImportError(f"a video needs imageio-ffmpeg: {checks.install_command('video')}")
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
    on_partial: Callable[[int], None] = lambda frames: None,
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
        files.reserve(Path(path), _PROBE)
        raise OSError(f"ffmpeg wrote {found} of {expected} frames")

"""Videos as mp4 files; needs the extra `video`."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, files

# Bytes that a disk cannot take where it was too full for ffmpeg, which does not report it.
_PROBE = 2**20


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
    early_end = None
    with files.atomic_write(path) as partial:
        with contextlib.closing(_VideoWriter(partial, (width, height), frames_per_second)) as writer:
            try:
                yield writer.append
            except BaseException as error:
                if not writer.frame_count:
                    raise
                early_end = error
        _check_frame_count(partial, writer.frame_count)
    if early_end is not None:
        on_partial(writer.frame_count)
        raise early_end


class _VideoWriter:
    """Sends frames to an ffmpeg process and counts them."""

    def __init__(self, path: Path, size: tuple[int, int], frames_per_second: float) -> None:
        import imageio_ffmpeg  # Only installed with the extra.

        self.frame_count = 0
        # Absolute: ffmpeg takes a relative name with a colon for a protocol.
        self._ffmpeg = imageio_ffmpeg.write_frames(
            str(path.absolute()), size, fps=frames_per_second, quality=7, macro_block_size=2, ffmpeg_log_level="quiet"
        )
        # A thread of its own: an interrupt while a frame is written would end ffmpeg before the file is complete.
        self._thread = ThreadPoolExecutor(1)
        self._ffmpeg.send(None)

    def append(self, frame: NDArray[np.uint8]) -> None:
        """Appends a frame."""
        self._thread.submit(self._send, np.ascontiguousarray(frame)).result()

    def close(self) -> None:
        """Ends the ffmpeg process, which completes the file."""
        self._thread.shutdown()
        self._ffmpeg.close()

    def _send(self, frame: NDArray[np.uint8]) -> None:
        self._ffmpeg.send(frame)
        self.frame_count += 1


def _check_frame_count(path: Path, expected: int) -> None:
    """Raises an OSError if a video has not all its frames; imageio-ffmpeg ignores ffmpeg's exit status."""
    import imageio_ffmpeg

    try:
        found, _ = imageio_ffmpeg.count_frames_and_secs(str(path.absolute()))
    except RuntimeError:
        found = 0
    if found != expected:
        files.reserve(path, _PROBE)
        raise OSError(f"ffmpeg wrote {found} of {expected} frames")

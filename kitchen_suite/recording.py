"""Writes episodes and videos, each file whole or not at all."""

import contextlib
import importlib.util
import json
import os
import shutil
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.episodes import Episode

_PATTERN = "episode_*.npz"


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Gives a path to write to, in the same folder; what was written there becomes `path` if all went well."""
    partial = partial_path(path)
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Removes files and folders, named as by `partial_path`, that killed processes have left unfinished in a folder."""
    for path in folder.glob(".*"):
        owner = path.name[1:].partition(".")[0]
        if owner.isdecimal() and not _is_running(int(owner)):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def partial_path(path: Path) -> Path:
    """Where this process writes what shall become `path`: in the same folder, hidden."""
    return path.with_name(f".{os.getpid()}.{path.name}")


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def claim_folder(folder: Path) -> None:
    """Makes a folder ready for episodes.

    Raises:
      OSError: it cannot be made or written to, or it holds episodes already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    if any(folder.glob(_PATTERN)):
        raise FileExistsError(f"{folder} holds episodes already, which are never overwritten: name another folder")


def save_episode(folder: Path, index: int, episode: Episode, metadata: Mapping[str, Any]) -> Path:
    """Writes an episode as a compressed npz that `numpy.load` reads without pickle.

    Its arrays: `observation/<key>` with one row more than `action`, `reward` and `discount`; and `metadata`, a string
    of JSON.

    Args:
      folder: where to.
      index: number of the episode, which makes up the file name.
      episode: what to write.
      metadata: what else should be known about it.

    Returns:
      The file.
    """
    known = {**metadata, "episode": index, "seed": episode.outcome.seed, "results": episode.outcome.results}
    arrays: dict[str, NDArray] = {
        **{f"observation/{key}": rows for key, rows in episode.observations.items()},
        "action": episode.actions,
        "reward": episode.rewards,
        "discount": episode.discounts,
    }
    return save_arrays(episode_path(folder, index), arrays, known)


def check_writable(folder: Path) -> None:
    """Raises a PermissionError if nothing can be written to a folder."""
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} may not be written to")


def episode_path(folder: Path, index: int) -> Path:
    """Where the episode of that number is."""
    return folder / _PATTERN.replace("*", f"{index:06d}")


def episode_indices(folder: Path) -> list[int]:
    """Numbers of the episodes in a folder, in order."""
    first = len(_PATTERN.partition("*")[0])
    numbers = (path.stem[first:] for path in folder.glob(_PATTERN))
    return sorted(int(number) for number in numbers if number.isdecimal())


def save_arrays(path: Path, arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> Path:
    """Writes a compressed npz of `arrays` and, as a string of JSON, `metadata`; returns the file."""
    everything: dict[str, Any] = {**arrays, "metadata": np.array(json.dumps(metadata))}
    with whole_file(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **everything)
    return path


def load_arrays(path: Path, what: str = "an episode") -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Reads what `save_arrays` wrote; gives arrays and metadata.

    Args:
      path: of the file.
      what: it should hold; the error names it.

    Raises:
      OSError: there is nothing of the kind.
    """
    with _opened(path, what) as file:
        arrays = dict(file)
        return arrays, json.loads(str(arrays.pop("metadata")))


def load_metadata(path: Path) -> dict[str, Any]:
    """Reads only the metadata that `save_arrays` wrote; raises what `load_arrays` does."""
    with _opened(path, "an episode") as file:
        return json.loads(str(file["metadata"]))


@contextlib.contextmanager
def _opened(path: Path, what: str) -> Iterator[Mapping[str, NDArray]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            yield file
    except (EOFError, KeyError, RuntimeError, TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise OSError(f"{path} does not hold {what}") from error


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

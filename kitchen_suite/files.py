"""Files that are written atomically: whole or not at all."""

import contextlib
import io
import json
import os
import shutil
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yields a temporary path in the same folder, which is renamed to `path` unless an exception is raised."""
    partial = partial_path(path)
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def remove_stale_partials(folder: Path) -> None:
    """Removes the temporary files and folders of `partial_path` that processes killed since have left in a folder."""
    for path in folder.glob(".*"):
        owner = path.name[1:].partition(".")[0]
        if owner.isdecimal() and not _is_running(int(owner)):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def partial_path(path: Path) -> Path:
    """Returns the hidden path in the same folder to which this process writes before renaming it to `path`."""
    return path.with_name(f".{os.getpid()}.{path.name}")


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def check_writable(folder: Path) -> None:
    """Raises a PermissionError if nothing can be written to a folder."""
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} may not be written to")


def save_arrays(path: Path, arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> Path:
    """Writes a compressed npz of `arrays` and, as a string of JSON, `metadata`; returns the file."""
    everything: dict[str, Any] = {**arrays, "metadata": np.array(json.dumps(metadata))}
    buffer = io.BytesIO()
    try:
        np.savez_compressed(buffer, **everything)
    except ValueError as error:
        # zipfile raises it where an interrupt came while it began an array.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise error.__context__ from None
        raise
    with atomic_write(path) as partial:
        partial.write_bytes(buffer.getvalue())
    return path


def load_arrays(path: Path, what: str = "an episode") -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Returns the arrays and the metadata that `save_arrays` wrote.

    Args:
      path: path of the file.
      what: its expected contents, for the error.

    Raises:
      OSError: the file does not exist, or holds something else.
    """
    with _opened(path, what) as file:
        arrays = dict(file)
        return arrays, json.loads(str(arrays.pop("metadata")))


def load_metadata(path: Path) -> dict[str, Any]:
    """Returns only the metadata that `save_arrays` wrote; raises as `load_arrays`."""
    with _opened(path, "an episode") as file:
        return json.loads(str(file["metadata"]))


@contextlib.contextmanager
def _opened(path: Path, what: str) -> Iterator[Mapping[str, NDArray]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            yield file
    except (EOFError, KeyError, RuntimeError, TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise OSError(f"{path} does not hold {what}") from error

"""Files and folders that are written atomically, and whose contents are checked when they are read."""

import contextlib
import dataclasses
import errno
import hashlib
import io
import json
import math
import os
import secrets
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, TypeVar

import msgspec
import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from kitchen_suite import checks

T = TypeVar("T")

# Bounds of what is read into memory [bytes], and so of what a damaged or malicious file can ask for.
MAX_ARRAY_BYTES = 512 * 2**20
_MAX_JSON_BYTES = 16 * 2**20


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yields a temporary path in the same folder, which is renamed to `path` unless an exception is raised."""
    with _partial(path) as partial:
        yield partial
        os.replace(partial, path)


@contextlib.contextmanager
def atomic_create(path: Path) -> Iterator[Path]:
    """Yields a temporary path as `atomic_write` does; of several processes that create one file, one succeeds.

    Raises a FileExistsError if the file exists at the end. On a file system without hard links, a process that is
    killed at the very end leaves an empty file, to be removed by hand.
    """
    with _partial(path) as partial:
        yield partial
        try:
            os.link(partial, path)
        except OSError as error:
            # File systems without hard links refuse them with one of these.
            if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK):
                raise
            os.close(os.open(path, os.O_CREAT | os.O_EXCL))
            os.replace(partial, path)


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yields the path of a folder to make, which is renamed to `path` unless an exception is raised.

    Raises an OSError if there is something at `path` at the end, an empty folder excepted.
    """
    with temporary_folder(path) as partial:
        yield partial
        os.rename(partial, path)


@contextlib.contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Makes a folder and its parents, where missing; after an exception, those that it made are removed if empty."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for each in missing:
            with contextlib.suppress(OSError):
                each.rmdir()
        raise


@contextlib.contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """Yields a hidden path beside `path` for a folder, which is removed at the end."""
    path = path.absolute()
    with made_folder(path.parent):
        partial = partial_path(path)
        try:
            yield partial
        finally:
            shutil.rmtree(partial, ignore_errors=True)


@dataclasses.dataclass(frozen=True)
class DescribedFolder:
    """A kind of folder with a description of its contents as JSON; nothing of another description is added to them.

    `file` is the name of the description's file, `contents` a pattern of the names of what is described. In messages,
    `kind` are the contents with the article, and `remedy` is the advice where such a folder exists already.
    """

    file: str
    kind: str
    contents: str
    remedy: str = "name another folder"

    def create(self, folder: Path, description: Mapping[str, Any]) -> None:
        """Makes a folder without contents; of several processes that do so at the same time, one succeeds.

        Raises a FileExistsError if it has a description or contents already, an OSError if it cannot be written to.
        """
        with made_folder(folder):
            check_writable(folder)
            try:
                with atomic_create(folder / self.file) as partial:
                    if any(folder.glob(self.contents)):
                        raise FileExistsError
                    write_json(partial, description)
            except FileExistsError as error:
                raise FileExistsError(f"{folder} holds {self.kind} already: {self.remedy}") from error

    def withdraw(self, folder: Path) -> None:
        """Removes the description of a folder without contents, and the folder if there is nothing else in it."""
        if not any(folder.glob(self.contents)):
            (folder / self.file).unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                folder.rmdir()

    def load(self, folder: Path) -> Any:
        """Returns the description of a folder; raises an OSError if there is none or it cannot be read."""
        path = folder / self.file
        if not path.exists():
            raise FileNotFoundError(f"{folder} does not hold {self.kind} to resume: there is no {self.file}")
        return load_json(path, f"the description of {self.kind}")

    def resume(self, folder: Path, present: Any, wanted: Mapping[str, Any]) -> None:
        """Raises a ValueError if the `present` description of a folder is not the `wanted` one."""
        check_writable(folder)
        if found := first_difference(present, wanted):
            raise ValueError(f"{folder} holds {self.kind} with {found}: name another folder")


def first_difference(present: Any, wanted: Mapping[str, Any]) -> str:
    """Returns name and values of the first entry in which two descriptions differ; empty if they are equal."""
    found = present if isinstance(present, Mapping) else {}
    for name in {**found, **wanted}:
        if found.get(name) != wanted.get(name):
            one, other = (checks.shortened(json.dumps(each.get(name))) for each in (found, wanted))
            return f"{name} {one}, not {other}"
    return ""


@contextlib.contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """Yields a temporary path, which is removed at the end; errors of writing name the file."""
    partial = partial_path(path)
    try:
        yield partial
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(partial)):
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def partial_path(path: Path) -> Path:
    """Returns a hidden path in the same folder, of a name that nothing else has, to write to before renaming it.

    What a killed process leaves there is read by nothing, and may be removed.
    """
    return path.with_name(f".kitchen-suite.{secrets.token_hex(8)}.{path.name}")


def check_destinations(
    paths: Mapping[str, Path], reserved: Iterable[Path] = (), reserved_folders: Iterable[Path] = ()
) -> None:
    """Raises an OSError or a ValueError unless each of some files can be written, and none in place of another.

    Whoever computes for long calls it before the start.

    Args:
      paths: of the files by the names of the arguments that they were given as.
      reserved: paths of other files that are read or written.
      reserved_folders: paths of folders in which nothing else may be written.
    """
    taken = {path.resolve(): "a file that is in use" for path in reserved}
    folders = [folder.resolve() for folder in reserved_folders]
    for name, path in paths.items():
        if inside := next((folder for folder in folders if folder in (path.resolve(), *path.resolve().parents)), None):
            raise ValueError(f"{name} must not be in the folder {str(inside)!r}: {str(path)!r}")
        if path.is_dir():
            raise IsADirectoryError(f"{name} must be a file, and {str(path)!r} is a folder")
        if path.exists() and not path.is_file():
            raise ValueError(f"{name} must be a file, and {str(path)!r} is none")
        if not path.absolute().parent.is_dir():
            raise FileNotFoundError(f"there is no folder {str(path.parent)!r} for {name}")
        check_writable(path.absolute().parent)
        if other := taken.get(path.resolve()):
            raise ValueError(f"{name} and {other} must be different files: both are {str(path)!r}")
        taken[path.resolve()] = name


def check_writable(folder: Path) -> None:
    """Raises a PermissionError if nothing can be written to a folder."""
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} may not be written to")


def file_digest(path: Path) -> str:
    """Returns the SHA-256 of a file's contents, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def cache_folder() -> Path | None:
    """Returns the folder of what the suite keeps for a user, which need not exist; None for a user without a home."""
    folder = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = Path(folder) if os.path.isabs(folder) else Path.home() / ".cache"
    except RuntimeError:
        return None
    return root / "kitchen-suite"


def save_arrays(path: Path, arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> Path:
    """Writes a compressed npz of `arrays` and, as a string of JSON, `metadata`; returns the file."""
    packed = _pack_with_metadata(arrays, metadata)
    with atomic_write(path) as partial:
        partial.write_bytes(packed)
    return path


def create_arrays(path: Path, arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> Path:
    """Writes what `save_arrays` does to a new file; raises a FileExistsError if there is one, as `atomic_create`."""
    packed = _pack_with_metadata(arrays, metadata)
    with atomic_create(path) as partial:
        partial.write_bytes(packed)
    return path


def _pack_with_metadata(arrays: Mapping[str, NDArray], metadata: Mapping[str, Any]) -> bytes:
    return pack_arrays({**arrays, "metadata": np.array(json_text(metadata))})


def pack_arrays(arrays: Mapping[str, NDArray]) -> bytes:
    """Returns the contents of a compressed npz of arrays."""
    buffer = io.BytesIO()
    everything: dict[str, Any] = {**arrays}
    try:
        np.savez_compressed(buffer, **everything)
    except ValueError as error:
        # zipfile raises it where an interrupt came while it began an array.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise error.__context__ from None
        raise
    return buffer.getvalue()


def load_arrays(path: Path, what: str, max_bytes: int = MAX_ARRAY_BYTES) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Returns what `save_arrays` wrote; an OSError unless it is `what`, in arrays of at most `max_bytes` together."""
    with reading(path, what), open(path, "rb") as file:
        arrays = unpack_arrays(file, max_bytes)
        return arrays, as_metadata(arrays.pop("metadata"))


def unpack_arrays(file: IO[bytes], max_bytes: int = MAX_ARRAY_BYTES) -> dict[str, NDArray]:
    """Returns the arrays of an npz, which together have at most `max_bytes`; any exception for damaged contents."""
    with zipfile.ZipFile(file) as contents:
        check_size(sum(info.file_size for info in contents.infolist()), max_bytes)
    # `numpy.load` would advise to unpickle whatever is no npz.
    with NpzFile(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, array in arrays.items():
        # NumPy returns the bytes of other files.
        if not isinstance(array, np.ndarray):
            raise ValueError(f"{name} is not an array")
    return arrays


def load_metadata(path: Path, what: str) -> dict[str, Any]:
    """Returns only the metadata that `save_arrays` wrote; raises as `load_arrays`."""
    with reading(path, what), open(path, "rb") as file:
        with zipfile.ZipFile(file) as contents:
            check_size(contents.getinfo("metadata.npy").file_size, _MAX_JSON_BYTES)
        with NpzFile(file, allow_pickle=False) as archive:
            return as_metadata(archive["metadata"])


def load_json(path: Path, what: str) -> Any:
    """Returns the contents of a JSON file; raises an OSError unless it holds `what`, in at most 16 MiB."""
    with reading(path, what):
        check_size(path.stat().st_size, _MAX_JSON_BYTES)
        return parse_json(path.read_bytes())


def write_json(path: Path, value: Any, indent: int = 2) -> None:
    """Writes a JSON file in UTF-8, which ends with a newline."""
    path.write_text(json_text(value, indent) + "\n", encoding="utf-8")


def json_text(value: Any, indent: int | None = None) -> str:
    """Returns a value as JSON; raises a ValueError that names the first number that JSON cannot hold, NaN or inf."""
    try:
        return json.dumps(value, indent=indent, allow_nan=False)
    except ValueError as error:
        for name, number in _not_finite(value, ""):
            raise ValueError(f"{name} is {number}, which JSON cannot hold") from error
        raise


def _not_finite(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """Yields name and value of each number that is not finite; an entry `b` of `a` has the name `a/b`."""
    if isinstance(value, float) and not math.isfinite(value):
        yield name or "the value", value
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, list | tuple):
        parts = enumerate(value)
    for key, part in parts:
        yield from _not_finite(part, f"{name}/{key}" if name else str(key))


def json_value(value: Any, name: str) -> Any:
    """Returns a value as JSON represents it, with Python's numbers and lists in place of NumPy's.

    Raises a TypeError if JSON cannot hold it.
    """
    try:
        return json.loads(json.dumps(value, default=_plain))
    except (RecursionError, TypeError, ValueError) as error:
        raise TypeError(f"{name} must consist of what JSON can hold, got {checks.shown(value)}") from error


def _plain(part: Any) -> Any:
    if not isinstance(part, np.generic | np.ndarray):
        raise TypeError
    return part.tolist()


def parse_json(text: str | bytes, max_size: int = _MAX_JSON_BYTES) -> Any:
    """Decodes JSON, in bytes of UTF-8; raises a ValueError if it is none, above `max_size`, or nested too deeply."""
    if len(text) > max_size:
        raise ValueError(f"larger than {max_size / 2**20:.0f} MiB")
    try:
        return json.loads(text if isinstance(text, str) else text.decode("utf-8"))
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def parse(value: Any, kind: type[T], what: str) -> T:
    """Converts decoded JSON to a dataclass; raises a ValueError unless it has fields of the annotated types."""
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise ValueError(f"{what}: {error}") from error


@contextlib.contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Raises an OSError that names the file, and `what` it should hold, in place of what a decoder raises."""
    try:
        # Devices and pipes may have no end.
        if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
            raise OSError("it is not a regular file")
        yield
    except FileNotFoundError as error:
        raise FileNotFoundError(f"no such file: {str(path)!r} (expected {what})") from error
    except OSError as error:
        if error.filename is None:
            raise OSError(f"{path} does not hold {what}: {error}") from error
        raise
    except Exception as error:  # Decoders of zip, npy, HDF5 and JSON raise dozens of types for damaged bytes.
        problem = ": ".join(filter(None, (type(error).__name__, str(error))))
        raise OSError(f"{path} does not hold {what} ({checks.shortened(problem)})") from error


def check_size(size: int, limit: int) -> None:
    """Raises an OSError if contents of `size` bytes are larger than a limit."""
    if size > limit:
        raise OSError(f"it would take {size} bytes of memory, more than {limit}")


def as_metadata(array: NDArray, max_size: int = _MAX_JSON_BYTES) -> dict[str, Any]:
    """Returns the JSON object in an array of one string; raises a ValueError if it holds something else."""
    metadata = parse_json(str(array), max_size)
    if not isinstance(metadata, dict):
        raise ValueError(f"metadata must be a JSON object, got {type(metadata).__name__}")
    return metadata

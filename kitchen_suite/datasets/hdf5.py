"""HDF5 files whose arrays grow episode by episode. Needs the extra `record`."""

import contextlib
import importlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kitchen_suite import checks, files

_CHUNK_ROWS, _CHUNK_BYTES = 1024, 2**18  # Most rows, and about the most bytes, of a chunk.


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[Any]:
    """Opens a new HDF5 file, which is at `path` at the end unless an exception is raised.

    Raises an ImportError without h5py, and a FileExistsError if there is something at `path`.
    """
    checks.installed(["h5py"], "a dataset in HDF5", "record")
    h5py = importlib.import_module("h5py")
    with files.atomic_create(path) as partial, h5py.File(partial, "w") as file:
        yield file


def append(file: Any, arrays: Mapping[str, NDArray]) -> None:
    """Adds rows to the datasets of an HDF5 file, which are made where they are missing."""
    for name, rows in arrays.items():
        if name not in file:
            shape = rows.shape[1:]
            chunks = (max(1, min(_CHUNK_ROWS, _CHUNK_BYTES // max(1, rows[:1].nbytes))), *shape)
            options = {"maxshape": (None, *shape), "chunks": chunks, "compression": "gzip"}
            file.create_dataset(name, (0, *shape), rows.dtype, **options)
        dataset = file[name]
        dataset.resize(len(dataset) + len(rows), axis=0)
        dataset[len(dataset) - len(rows) :] = rows

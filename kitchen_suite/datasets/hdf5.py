"""HDF5 files: the only module that opens them. Needs the extra `record`.

A file of HDF5 can have its arrays in other files, behind links, and compressed by libraries that are loaded from a
folder of the machine; what is read here has none of these. Sizes are checked before contents.
"""

import contextlib
import errno
import math
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kitchen_suite import files, installation

_CHUNK_ROWS, _CHUNK_BYTES = 1024, 2**18  # Most rows, and about the most bytes, of a chunk.

# Numbers of the filters that come with HDF5 and h5py: deflate, shuffle, Fletcher's checksum, nbit, scale-offset, LZF.
_FILTERS = (1, 2, 3, 5, 6, 32000)

_NUMBER_BYTES = 8  # Of a number, once it is read as float64.

# Space that a file needs for arrays, as a multiple of their bytes, and for all else, such as attributes [bytes]:
# chosen, several times what it takes.
_LARGEST_OVERHEAD = 2
_LEAST_SPACE = 4 * 2**20


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[Any]:
    """Opens a new HDF5 file, which is at `path` at the end unless an exception is raised.

    Raises an ImportError without h5py, and a FileExistsError if there is something at `path`.
    """
    installation.installed(["h5py"], "a dataset in HDF5", "record")
    with files.atomic_create(path) as partial:
        check_space(partial, 0)
        with library().File(partial, "w") as file:
            yield file


def check_space(path: Path, size: int) -> None:
    """Raises an OSError unless a file can grow by about a number of bytes, within free space, quotas and limits.

    HDF5 must not find out by itself: where it cannot write, it ends the process by a segmentation fault, then or when
    it closes the file.
    """
    present = path.stat().st_size if path.exists() else 0
    try:
        # On the file system of the file; it has no name, and is gone at the end.
        with tempfile.TemporaryFile(dir=path.parent) as space:
            os.posix_fallocate(space.fileno(), present, _LARGEST_OVERHEAD * size + _LEAST_SPACE)
    except OSError as error:
        reason = os.strerror(error.errno or errno.ENOSPC)
        raise OSError(error.errno, f"{reason}: there is no space for a file of HDF5") from error


def append(file: Any, arrays: Mapping[str, NDArray]) -> None:
    """Adds rows to the datasets of an HDF5 file, which are made where they are missing, and writes them at once.

    Raises an OSError, with nothing added, if there is no space for them.
    """
    check_space(Path(file.file.filename), sum(rows.nbytes for rows in arrays.values()))
    for name, rows in arrays.items():
        if name not in file:
            shape = rows.shape[1:]
            chunks = (max(1, min(_CHUNK_ROWS, _CHUNK_BYTES // max(1, rows[:1].nbytes))), *shape)
            options = {"maxshape": (None, *shape), "chunks": chunks, "compression": "gzip"}
            file.create_dataset(name, (0, *shape), rows.dtype, **options)
        dataset = file[name]
        dataset.resize(len(dataset) + len(rows), axis=0)
        dataset[len(dataset) - len(rows) :] = rows
    file.file.flush()


def compress(path: Path, axes: int) -> None:
    """Compresses the arrays of more than some axes in a file, row by row and without loss; readers need not know.

    The file is one that this program has written.
    """
    compressed = path.with_suffix(".compressed")
    check_space(compressed, path.stat().st_size)
    with library().File(path, "r") as source, library().File(compressed, "w") as target:

        def copy(name: str, item: Any) -> None:
            if isinstance(item, library().Group):
                made = target.create_group(name)
            elif item.ndim <= axes:
                source.copy(item, target, name)
                return
            else:
                options = {"chunks": (1, *item.shape[1:]), "compression": "gzip", "shuffle": True}
                made = target.create_dataset(name, data=item[()], maxshape=item.maxshape, **options)
            made.attrs.update(item.attrs)

        source.visititems(copy)
        target.attrs.update(source.attrs)
    os.replace(compressed, path)


def read_arrays(path: Path, names: Collection[str]) -> dict[str, NDArray]:
    """Returns the arrays of numbers of some names at the top of a file, those that it has.

    Raises an ImportError without h5py, and an OSError if the file cannot be read, or they are anything else.
    """
    installation.installed(["h5py"], "a file of D4RL", "record")
    with files.reading(path, "HDF5"), library().File(path, "r") as file:
        found = {name: _checked(file, name) for name in names if file.id.links.exists(name.encode())}
        # Those of a null dataspace have nothing.
        found = {name: item for name, item in found.items() if getattr(item, "shape", ()) is not None}
        if other := [name for name, item in found.items() if not isinstance(item, library().Dataset)]:
            raise ValueError(f"{other[0]} is not an array")
        _check_size(found.values())
        return {name: item[()] for name, item in found.items()}


def check_group(path: Path, name: str) -> None:
    """Raises an OSError unless a file has a group of arrays, at its top, that another program can read safely."""
    with files.reading(path, "HDF5"), library().File(path, "r") as file:
        _check_size(_datasets(_checked(file, name)))


def library() -> Any:
    """Returns h5py; raises an ImportError without it."""
    import h5py

    return h5py


def _datasets(item: Any) -> Iterator[Any]:
    """Yields the checked datasets of a group, or a dataset itself; a RecursionError for a group that is in itself."""
    if isinstance(item, library().Dataset):
        yield item
    else:
        for name in item:
            yield from _datasets(_checked(item, name))


def _checked(group: Any, name: str) -> Any:
    """Returns an item of a group; raises a ValueError for a link, and for an array that is not in the file."""
    h5py = library()
    # Not `name in group`, which follows links.
    if group.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise ValueError(f"{name} is a link to another place")
    item = group[name]
    if isinstance(item, h5py.Group):
        return item
    if not isinstance(item, h5py.Dataset):
        raise ValueError(f"{name} is no array")
    if item.shape is None:
        return item
    if item.is_virtual or item.external:
        raise ValueError(f"{name} has its contents elsewhere")
    created = item.id.get_create_plist()
    filters = [created.get_filter(number)[0] for number in range(created.get_nfilters())]
    if unknown := [number for number in filters if number not in _FILTERS]:
        raise ValueError(f"{name} is compressed by filters {unknown}, which are not read")
    if item.dtype.kind not in "biufS" or item.dtype.hasobject:
        raise ValueError(f"{name} holds {item.dtype}, not numbers")
    return item


def _check_size(datasets: Iterable[Any]) -> None:
    """Raises an OSError if datasets have more numbers together than can be read."""
    sizes = (math.prod(item.shape or ()) * max(item.dtype.itemsize, _NUMBER_BYTES) for item in datasets)
    files.check_size(sum(sizes), files.MAX_ARRAY_BYTES)

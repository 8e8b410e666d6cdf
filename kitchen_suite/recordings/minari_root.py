"""The folder that Minari keeps its datasets in."""

import contextlib
import os
from collections.abc import Iterator

_DATASETS = "MINARI_DATASETS_PATH"


@contextlib.contextmanager
def datasets_in(path: str | os.PathLike | None) -> Iterator[None]:
    """Lets Minari look for datasets, and write them, in a folder; where it does anyway without one."""
    before = os.environ.get(_DATASETS)
    if path is not None:
        os.environ[_DATASETS] = os.path.abspath(path)
    try:
        yield
    finally:
        os.environ.pop(_DATASETS, None)
        os.environ.update({} if before is None else {_DATASETS: before})

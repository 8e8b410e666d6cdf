"""Converts recordings to datasets of other programs."""

import contextlib
import os
from pathlib import Path

from kitchen_suite import checks, files
from kitchen_suite.datasets.formats import FORMATS
from kitchen_suite.episodes.recording import Recording

_MAX_SEED = 2**63 - 1  # HDF5 has 64 bits.


def convert(
    recording: str | os.PathLike[str], format: str, dataset: str, data_path: str | os.PathLike[str] | None = None
) -> Path:
    """Writes the episodes of a recording as a dataset, of which there is nothing after an error.

    Args:
      recording: folder of `kitchen-record`.
      format: name of the dataset's format, one of `formats.FORMATS`.
      dataset: name of the dataset, such as `me/kettle`; in Minari it ends in a version, such as `me/kettle-v0`.
      data_path: folder of the datasets. When omitted that of Minari or LeRobot; other formats have none of their own.

    Returns:
      The dataset's file or folder.

    Raises:
      FileExistsError: there is something of this name, which is never replaced.
      ImportError: a package is missing that writes the format.
      OSError: the recording cannot be read, or the dataset not be written.
      ValueError: the format is unknown, the name malformed, or the recording cannot be such a dataset.
    """
    chosen = FORMATS[checks.choice(format, FORMATS, "format")]
    source = Recording.open(Path(recording))
    _check_source(recording, source)
    chosen.resolve("check_name")(dataset)
    if obs_types := chosen.resolve("obs_types"):
        obs_type = source.spec.env_class.find_obs_type(source.spec.argument("obs_type"))
        checks.choice(obs_type, obs_types, f"{chosen.title}'s obs_type")
    with chosen.resolve("folder")(None if data_path is None else Path(data_path)) as folder:
        path = folder / f"{dataset}{chosen.suffix}"
        if path.exists():
            raise FileExistsError(f"{path} exists already, and is never replaced: name another dataset")
        with files.made_folder(path.parent), contextlib.closing(source.spec.make_environment()) as environment:
            episodes = (source.load_fitting(index, environment) for index in source.indices)
            chosen.resolve("write")(path, source.spec, episodes)
    return path


def _check_source(recording: str | os.PathLike[str], source: Recording) -> None:
    """Raises a ValueError unless a recording can become a dataset."""
    if not source.indices:
        raise ValueError(f"{recording} holds no episodes")
    spec = source.spec
    # The seeds of others are not those of `env.reset(seed=...)`, which datasets promise.
    if spec.origin is not None or spec.seeding != "gymnasium":
        maker = "kitchen-rollout" if spec.origin is None else "kitchen-convert"
        raise ValueError(f"{recording} was made by {maker}: datasets are made of recordings of kitchen-record")
    if (last := spec.seed + source.indices[-1]) > _MAX_SEED:
        raise ValueError(f"seeds in a dataset may not exceed {_MAX_SEED}, got {last}")

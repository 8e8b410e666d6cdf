"""Formats of datasets that recordings are converted to.

A format is a module with a function `write`, and a row in `FORMATS`.
"""

import contextlib
import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import MappingProxyType

from kitchen_suite import checks
from kitchen_suite.datasets import d4rl, minari, ogbench, robomimic
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.lerobot import datasets as lerobot
from kitchen_suite.lerobot.observations import OBS_TYPES

_NAME = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*", re.ASCII)  # As the Hugging Face hub accepts names.


def _check_name(dataset: str) -> None:
    if not _NAME.fullmatch(dataset):
        raise ValueError(f"{checks.shown(dataset)} is no name of a dataset, such as me/kettle")


def _given_folder(data_path: Path | None) -> AbstractContextManager[Path]:
    if data_path is None:
        raise ValueError("datasets in this format have no folder of their own: name one as data_path")
    return contextlib.nullcontext(data_path)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Format:
    """A format of datasets.

    Attributes:
      name: by which it is chosen.
      title: the program that defines it.
      write: writes episodes of a specification to a path; the file or folder is whole or not there.
      suffix: of the path; empty for a folder.
      check_name: raises a ValueError for a name that a dataset cannot have.
      folder: returns a context with the folder of all datasets: the given one or, for None, the program's own.
      obs_types: observation types of the suite that it holds; empty for all.
    """

    name: str
    title: str
    write: Callable[[Path, EpisodeSpec, Iterable[Episode]], None]
    suffix: str = ""
    check_name: Callable[[str], None] = _check_name
    folder: Callable[[Path | None], AbstractContextManager[Path]] = _given_folder
    obs_types: tuple[str, ...] = ()


# By name.
FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        each.name: each
        for each in (
            Format(
                name="minari",
                title="Minari",
                write=minari.write,
                check_name=minari.check_id,
                folder=minari.folder,
            ),
            Format(
                name="lerobot",
                title="LeRobot",
                write=lerobot.write,
                folder=lerobot.folder,
                obs_types=OBS_TYPES,
            ),
            Format(name="robomimic", title="robomimic", write=robomimic.write, suffix=".hdf5"),
            Format(name="ogbench", title="OGBench", write=ogbench.write, suffix=".npz"),
            Format(name="d4rl", title="D4RL", write=d4rl.write, suffix=".hdf5"),
        )
    }
)

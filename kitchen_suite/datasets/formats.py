"""Formats of datasets that recordings are converted to.

A format is a module with a function `write`, and a row in `FORMATS`. This module imports none of them, so that the
command's help can list the formats.
"""

import contextlib
import dataclasses
import pkgutil
import re
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from kitchen_suite import checks

_NAME = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*", re.ASCII)  # As the Hugging Face hub accepts names.


def check_name(dataset: str) -> None:
    """Raises a ValueError for a name that a dataset cannot have."""
    if not _NAME.fullmatch(dataset):
        raise ValueError(f"{checks.shown(dataset)} is no name of a dataset, such as me/kettle")


def given_folder(data_path: Path | None) -> AbstractContextManager[Path]:
    """Returns a context with the folder that is given; raises a ValueError if none is."""
    if data_path is None:
        raise ValueError("datasets in this format have no folder of their own: name one as data_path")
    return contextlib.nullcontext(data_path)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Format:
    """A format of datasets; functions are named by their entry points, see `resolve`.

    Attributes:
      name: by which it is chosen.
      title: the program that defines it.
      write: writes episodes of a specification to a path; the file or folder is whole or not there.
      suffix: of the path; empty for a folder.
      check_name: raises a ValueError for a name that a dataset cannot have.
      folder: returns a context with the folder of all datasets: the given one or, for None, the program's own.
      obs_types: entry point of the observation types of the suite that it holds; None where `write` refuses what it
        cannot hold.
    """

    name: str
    title: str
    write: str
    suffix: str = ""
    check_name: str = "kitchen_suite.datasets.formats:check_name"
    folder: str = "kitchen_suite.datasets.formats:given_folder"
    obs_types: str | None = None

    def resolve(self, attribute: str) -> Any:
        """Returns the object that an attribute names by its entry point; None for None."""
        value = getattr(self, attribute)
        return None if value is None else pkgutil.resolve_name(value)


_FORMATS = (
    Format(
        name="minari",
        title="Minari",
        write="kitchen_suite.datasets.minari:write",
        check_name="kitchen_suite.datasets.minari:check_id",
        folder="kitchen_suite.datasets.minari:folder",
    ),
    Format(
        name="lerobot",
        title="LeRobot",
        write="kitchen_suite.lerobot.datasets:write",
        folder="kitchen_suite.lerobot.datasets:folder",
        obs_types="kitchen_suite.lerobot.observations:OBS_TYPES",
    ),
    Format(name="robomimic", title="robomimic", write="kitchen_suite.datasets.robomimic:write", suffix=".hdf5"),
    Format(name="ogbench", title="OGBench", write="kitchen_suite.datasets.ogbench:write", suffix=".npz"),
    Format(name="d4rl", title="D4RL", write="kitchen_suite.datasets.d4rl:write", suffix=".hdf5"),
)

FORMATS: Mapping[str, Format] = MappingProxyType({each.name: each for each in _FORMATS})
"""By name."""

"""Datasets that are made of a recording: their formats, and what they have in common."""

import abc
import pkgutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import gymnasium

from kitchen_suite import checks
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.rollouts.spec import RecordingSpec


class DatasetPlan(abc.ABC):
    """A dataset that will hold the first episodes of a recording.

    Attributes:
      dataset_id: its name.
      spec: of the recording.
      count: number of episodes.
    """

    def __init__(self, dataset_id: str, spec: RecordingSpec, count: int, root: Path | None = None) -> None:
        """Checks that the dataset can be made, or has been made already.

        Args:
          dataset_id: its name.
          spec: of the recording.
          count: number of episodes.
          root: folder of the datasets; that of the format's library when omitted.

        Raises:
          ImportError: the library is not installed.
          ValueError: the name is malformed or taken by another dataset, or the recording cannot be a dataset.
        """
        self.dataset_id, self.spec, self.count, self._root = dataset_id, spec, count, root

    @property
    @abc.abstractmethod
    def path(self) -> Path:
        """Folder of the dataset."""

    @property
    def is_missing(self) -> bool:
        """Whether the dataset has still to be made."""
        return not self.path.exists()

    @abc.abstractmethod
    def make(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        """Makes the dataset as a whole or, after an error, not at all.

        Args:
          environment: of the recording.
          folder: of the recording.
          indices: numbers of the episodes.
        """

    def _check_same(self, spec: object, count: object) -> None:
        """Raises a ValueError unless a dataset that is there holds the first `count` episodes of the recording."""
        if spec != self.spec.as_json():
            raise ValueError(f"dataset {self.dataset_id!r} exists and holds another recording: name another one")
        if count != self.count:
            raise ValueError(
                f"dataset {self.dataset_id!r} exists and is of the first {count} episodes of this recording, "
                f"not of {self.count}: name another one"
            )


# Entry points of the plans by `--format`; the first is the default.
FORMATS: Mapping[str, str] = MappingProxyType(
    {
        "minari": "kitchen_suite.recordings.minari_dataset:MinariPlan",
        "lerobot": "kitchen_suite.recordings.lerobot_dataset:LeRobotPlan",
    }
)


def plan(name: str, dataset_id: str, spec: RecordingSpec, count: int, root: Path | None) -> DatasetPlan:
    """Plans a dataset of a format, one of `FORMATS`; further arguments and errors as of `DatasetPlan`."""
    kind: type[DatasetPlan] = pkgutil.resolve_name(FORMATS[checks.choice(name, FORMATS.keys(), "format")])
    return kind(dataset_id, spec, count, root)

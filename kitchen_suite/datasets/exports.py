"""The base of datasets in files of other programs, and the arrays of an episode that several of them have."""

import abc
import dataclasses
import itertools
import math
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.datasets.formats import DatasetPlan
from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeBuffer
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec, reset_to_seed
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import has_pictures

VALIDATION = 10  # One episode in ten is for validation, in the layouts that have such.


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportRecord:
    """Contents of the record beside a dataset: the program that reads it, and the specification of the recording.

    `num_episodes` is the number asked for, `seeds` are in the order of the dataset.
    """

    format: str
    recording: Mapping[str, Any]
    num_episodes: int
    seeds: list[int]


class ExportPlan(DatasetPlan):
    """A dataset `OWNER/NAME` below a folder: one file or folder, or several files whose names begin with NAME.

    Attributes:
      title: name of the program that reads it.
      suffix: of its file; empty for a folder.
      package: that writes it, and the extra that installs this; None where NumPy does.
      holds_pictures: whether observations may have pictures.
    """

    title: ClassVar[str]
    suffix: ClassVar[str] = ""
    package: ClassVar[tuple[str, str] | None] = None
    holds_pictures: ClassVar[bool] = False

    def __init__(self, dataset_id: str, spec: EpisodeSpec, count: int, root: Path | None = None) -> None:
        super().__init__(dataset_id, spec, count, root)
        self.check_installed()
        self._check_name(f"a dataset for {self.title}")
        if root is None:
            raise ValueError(f"a dataset for {self.title} needs a folder to be in: --data_path")
        if not self.holds_pictures and has_pictures(spec.env_class.find_obs_type(spec.argument("obs_type"))):
            raise ValueError(f"a dataset for {self.title} holds no pictures: record other observations")
        self.path = root / f"{dataset_id}{self.suffix}"
        self._record_file = record_file(self.path)
        if self._record_file.exists():
            record = read_record(self._record_file)
            if record.format != self.title:
                raise ValueError(f"dataset {dataset_id!r} exists and is one for {record.format}: name another one")
            self._check_same(record.recording, record.num_episodes)
            if not self.path.exists():
                raise ValueError(f"{self.path} is gone, but not {self._record_file}: remove that as well")
        elif taken := self._taken:
            raise ValueError(taken)

    @classmethod
    def check_installed(cls) -> None:
        """Raises an ImportError unless the package is there that reads and writes such datasets."""
        if cls.package:
            name, extra = cls.package
            checks.installed([name], f"a dataset for {cls.title}", extra)

    @property
    def is_missing(self) -> bool:
        return not self._record_file.exists()

    @property
    def seeds(self) -> list[int]:
        return read_record(self._record_file).seeds

    def make(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        with files.temporary_folder(self.path) as elsewhere:
            elsewhere.mkdir()
            self.write(elsewhere, environment, map(folder.load, indices), len(indices))
            record = {
                "format": self.title,
                "recording": self.spec.as_json(),
                "num_episodes": self.count,
                "seeds": [folder.spec.seed_of(index) for index in indices],
            }
            files.write_json(elsewhere / self._record_file.name, record, indent=1)
            self._move(elsewhere)

    def _move(self, elsewhere: Path) -> None:
        """Moves what has been written to its place, the record last; nothing is there after an error."""
        moved: list[Path] = []
        try:
            if taken := self._taken:
                raise FileExistsError(taken)
            for made in sorted(elsewhere.iterdir(), key=lambda path: path.name == self._record_file.name):
                os.rename(made, self.path.with_name(made.name))
                moved.append(self.path.with_name(made.name))
        except BaseException:
            for path in moved:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            raise

    @property
    def _taken(self) -> str:
        """Message that a file of the dataset exists already; empty if none does."""
        found = next((path for path in (self.path, *self.further) if path.exists()), None)
        return f"{found} exists, and is not of this dataset: name another one" if found else ""

    @property
    def further(self) -> tuple[Path, ...]:
        """Files that the dataset may have beside `path`."""
        return ()

    @abc.abstractmethod
    def write(self, folder: Path, environment: gymnasium.Env, episodes: Iterable[EpisodeArrays], count: int) -> None:
        """Writes the files of the dataset to an empty folder, by the names that they are to have."""

    @classmethod
    @abc.abstractmethod
    def columns(cls, environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> dict[str, NDArray]:
        """Returns the arrays that a dataset holds of an episode of a recording, by their names there."""

    @classmethod
    @abc.abstractmethod
    def read(cls, path: Path, count: int) -> Iterator[tuple[NDArray, dict[str, NDArray]]]:
        """Yields actions `(T, n)` and all `columns` of each of `count` episodes; any exception for damaged ones."""


def record_file(path: Path) -> Path:
    """Returns the path of the record beside a dataset."""
    return path.with_name(f"{path.name}.kitchen_suite.json")


def read_record(path: Path) -> ExportRecord:
    """Reads the record beside a dataset; raises an OSError if it cannot be read."""
    return files.load_record(path, ExportRecord, "the record of a dataset")


def check_count(found: int, count: int) -> None:
    """Raises a ValueError unless a dataset has the episodes of its record."""
    if found != count:
        raise ValueError(f"it has {found} episodes, its record {count}")


def episodes_between(columns: Mapping[str, Any], ends: NDArray, count: int) -> Iterator[dict[str, NDArray]]:
    """Yields the rows of each of `count` episodes, whose `ends` are the numbers of the rows after their last ones.

    `columns` are arrays of NumPy, HDF5 or zarr by name, with the rows of all episodes one after the other.
    """
    check_count(len(ends), count)
    for name, rows in columns.items():
        if len(rows) != ends[-1]:
            raise ValueError(f"{name} has {len(rows)} rows, not {ends[-1]}")
    row_bytes = sum(rows.dtype.itemsize * math.prod(rows.shape[1:]) for rows in columns.values())
    for start, stop in itertools.pairwise([0, *ends.tolist()]):
        files.check_size((stop - start) * row_bytes, files.MAX_ARRAY_BYTES)
        yield {name: rows[start:stop] for name, rows in columns.items()}


def state_observations(episode: EpisodeArrays) -> NDArray:
    """Returns the observed numbers `(T + 1, m)` of an episode, without goals and pictures."""
    arrays = episode.arrays
    if "observation/observation" in arrays:
        return arrays["observation/observation"]
    parts = [rows for name, rows in arrays.items() if name.startswith("observation") and rows.ndim == 2]
    return np.concatenate(parts, axis=1) if parts else np.empty((episode.steps + 1, 0))


def further_observations(episode: EpisodeArrays) -> dict[str, NDArray]:
    """Returns what else is observed in numbers, such as the tasks that are requested, by name; not goals of tasks."""
    names = [name for name, rows in episode.arrays.items() if name.startswith("observation/") and rows.ndim == 2]
    left_out = ("observation/observation", "observation/achieved_goal/", "observation/desired_goal/")
    has_state = "observation/observation" in episode.arrays
    return {key_of(name): episode.arrays[name] for name in names if has_state and not name.startswith(left_out)}


def key_of(name: str) -> str:
    """Returns the name of an array of observations as a key without slashes and blanks."""
    return name.removeprefix("observation/").replace("/", "_").replace(" ", "_")


def physics_states(environment: gymnasium.Env, spec: EpisodeSpec, episode: EpisodeArrays) -> NDArray[np.float64]:
    """Returns time [s], qpos and qvel `(T + 1, 1 + nq + nv)` of the physics in an episode, which is played again.

    Raises an OSError if rewards or observed numbers are not those that were recorded.
    """
    assert episode.seed is not None
    buffer, states = EpisodeBuffer(*reset_to_seed(environment, episode.seed, spec.seeding)), []
    physics = suite_env(environment).environment.physics
    for step in range(episode.steps + 1):
        data = physics.data
        states.append(np.concatenate([[data.time], data.qpos, data.qvel]))
        if step < episode.steps:
            buffer.step(environment, episode.arrays["action"][step])
        if differing := buffer.differing(episode.arrays):
            problem = f"the episode of seed {episode.seed} does not play again here, where its {differing} differs"
            raise OSError(f"{problem}: it was recorded elsewhere")
    return np.stack(states)


def check_room(folder: Path, size: int) -> None:
    """Raises an OSError unless the disk of a folder has room for `size` bytes: libraries report that less clearly."""
    spare = folder / "reserved"
    files.reserve(spare, size)
    spare.unlink()

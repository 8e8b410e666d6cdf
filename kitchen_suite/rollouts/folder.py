"""A folder of episodes: one file each, written atomically, and the specification that they were made from."""

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from kitchen_suite import files
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeStats
from kitchen_suite.rollouts.spec import RecordingSpec

SPEC_FILE = "recording.json"
_PATTERN = "episode_*.npz"


class RecordingFolder:
    """The folder of one recording."""

    def __init__(self, folder: Path, spec: RecordingSpec) -> None:
        """Names the folder; see `create`, `claim` and `open`."""
        self._folder, self._spec = folder, spec

    @classmethod
    def create(cls, folder: Path, spec: RecordingSpec) -> "RecordingFolder":
        """Starts a new recording.

        Raises:
          OSError: the folder cannot be made or written to, or holds episodes already.
        """
        folder.mkdir(parents=True, exist_ok=True)
        files.check_writable(folder)
        if any(folder.glob(_PATTERN)):
            raise FileExistsError(f"{folder} holds episodes already, which are never overwritten: name another folder")
        with files.atomic_write(folder / SPEC_FILE) as partial:
            partial.write_text(json.dumps(spec.as_json(), indent=2) + "\n", encoding="utf-8")
        return cls(folder, spec)

    @classmethod
    def claim(cls, folder: Path, spec: RecordingSpec) -> "RecordingFolder":
        """Starts a new recording, or continues an interrupted one of the same specification.

        Raises:
          OSError: the folder cannot be made or written to, or holds other episodes.
          ValueError: it holds a recording of another specification.
        """
        if not (folder / SPEC_FILE).exists():
            return cls.create(folder, spec)
        present = cls.open(folder)
        _check_same(folder, present.spec.as_json(), spec.as_json())
        files.check_writable(folder)
        files.remove_stale_partials(folder)
        return present

    @classmethod
    def open(cls, folder: Path) -> "RecordingFolder":
        """Opens a recording.

        Raises:
          OSError: there is none.
          ValueError: its specification cannot be read.
        """
        path = folder / SPEC_FILE
        try:
            return cls(folder, RecordingSpec.from_json(json.loads(path.read_text(encoding="utf-8"))))
        except ValueError as error:
            raise ValueError(f"{path} does not describe a recording: {error}") from error

    @property
    def spec(self) -> RecordingSpec:
        """The specification of the episodes."""
        return self._spec

    @property
    def indices(self) -> list[int]:
        """Numbers of the episodes in the folder, in order."""
        first = len(_PATTERN.partition("*")[0])
        numbers = (path.stem[first:] for path in self._folder.glob(_PATTERN))
        return sorted(int(number) for number in numbers if number.isdecimal())

    def save(self, episode: EpisodeArrays, stats: EpisodeStats) -> None:
        """Writes an episode as a compressed npz that `numpy.load` reads without pickle.

        It holds the arrays of the episode, and `metadata`: a string of JSON with the statistics and the specification.
        """
        metadata = {
            "episode": episode.index,
            "seed": episode.seed,
            "steps": episode.steps,
            "total_reward": stats.total_reward,
            "seconds": episode.seconds,
            "results": stats.metrics,
            "recording": self._spec.as_json(),
        }
        files.save_arrays(self._path(episode.index), episode.arrays, metadata)

    def load(self, index: int) -> EpisodeArrays:
        """Reads an episode."""
        arrays, metadata = files.load_arrays(self._path(index))
        with self._reading(index):
            return EpisodeArrays(index=index, seed=metadata["seed"], arrays=arrays, seconds=metadata["seconds"])

    def load_stats(self, index: int) -> EpisodeStats:
        """Reads the statistics of an episode, and not its arrays."""
        metadata = files.load_metadata(self._path(index))
        names = ("seed", "steps", "total_reward", "seconds")
        with self._reading(index):
            return EpisodeStats(metrics=metadata["results"], **{name: metadata[name] for name in names})

    @contextlib.contextmanager
    def _reading(self, index: int) -> Iterator[None]:
        """Raises an OSError where metadata lacks an entry of an episode."""
        try:
            yield
        except (KeyError, TypeError) as error:
            raise OSError(f"{self._path(index)} does not hold an episode") from error

    def _path(self, index: int) -> Path:
        return self._folder / _PATTERN.replace("*", f"{index:06d}")


def _check_same(folder: Path, present: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raises a ValueError that names the first difference."""
    for name, value in present.items():
        if value != wanted[name]:
            raise ValueError(
                f"{folder} holds a recording with {name} {json.dumps(value)}, not {json.dumps(wanted[name])}: "
                "name another folder"
            )

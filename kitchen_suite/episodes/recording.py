"""A folder of episodes: one file each, written atomically, and the specification that they were made from."""

import contextlib
import dataclasses
import hashlib
import os
import secrets
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium

from kitchen_suite import files
from kitchen_suite.episodes.episode import Episode, NamedArrays, Summary
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.episodes.transitions import Transitions
from kitchen_suite.policies import PolicyError
from kitchen_suite.tasks.metrics import Metrics

SPEC_FILE, _PATTERN = "recording.json", "episode_*.npz"
_RECORDING = files.DescribedFolder(SPEC_FILE, "a recording", _PATTERN)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Metadata:
    """Metadata of an episode's file; `results` are the task's metrics. Older files lack those with a default."""

    episode: int
    seed: int | None
    steps: int
    total_reward: float
    seconds: float
    results: Metrics
    instruction: str = ""
    actions_sha256: str | None = None
    recording: Mapping[str, Any]


class Recording:
    """A folder of episodes, which all have one specification; `kitchen_suite.record` makes it, and `open` reads it.

    Iterating over it reads the episodes, each an `Episode` with seed, success, return, length, and arrays by name.

    Attributes:
      folder: of the files.
      spec: domain, task and arguments of the environments, the policy, and the seed of the first episode.
    """

    def __init__(self, folder: Path, spec: EpisodeSpec) -> None:
        self.folder, self.spec = folder, spec

    @classmethod
    def create(cls, folder: Path, spec: EpisodeSpec) -> "Recording":
        """Starts a new recording; raises as `claim`, and a FileExistsError for a folder that holds episodes already."""
        if any(folder.glob(_PATTERN)):
            raise FileExistsError(f"{folder} holds episodes already, which are never overwritten: name another folder")
        return cls.claim(folder, spec)

    @classmethod
    def claim(cls, folder: Path, spec: EpisodeSpec) -> "Recording":
        """Starts a new recording, or continues an interrupted one; a ValueError if its specification is another one.

        Of several processes that start different recordings in one folder at the same time, one succeeds. Raises an
        OSError if the folder cannot be made or written to, or holds other episodes.
        """
        try:
            _RECORDING.create(folder, spec.as_json())
        except FileExistsError:
            if not (folder / SPEC_FILE).exists():
                raise
        present = cls.open(folder)
        _RECORDING.resume(folder, present.spec.as_json(), spec.as_json())
        return present

    @classmethod
    def open(cls, folder: str | Path) -> "Recording":
        """Opens a recording; raises an OSError if there is none, or it cannot be read."""
        folder = Path(folder)
        path = folder / SPEC_FILE
        record = files.load_json(path, "the specification of a recording")
        try:
            return cls(folder, EpisodeSpec.from_json(record))
        except ValueError as error:
            raise OSError(f"{path} does not describe a recording: {error}") from error

    @contextlib.contextmanager
    def withdrawn_without_episodes(self) -> Iterator[None]:
        """Context in which episodes are played and written: if they cannot be, and there is none, nothing is left."""
        try:
            yield
        except (OSError, PolicyError):
            _RECORDING.withdraw(self.folder)
            raise

    @property
    def indices(self) -> list[int]:
        """Numbers of the episodes in the folder, in order."""
        first = len(_PATTERN.partition("*")[0])
        numbers = (path.stem[first:] for path in self.folder.glob(_PATTERN))
        return sorted(int(number) for number in numbers if number.isdecimal())

    @property
    def successful(self) -> list[int]:
        """Numbers of the episodes that succeeded, in order; raises as `load`."""
        return [index for index in self.indices if self.load_summary(index).success]

    def present(self, count: int) -> list[int]:
        """Returns the numbers of those of the first `count` episodes that are in the folder."""
        return [index for index in self.indices if index < count]

    def missing(self, count: int) -> list[tuple[int, int]]:
        """Returns number and seed of those of the first `count` episodes that are not in the folder."""
        present = {*self.indices}
        return [(index, self.spec.seed_of(index)) for index in range(count) if index not in present]

    def append(self, episode: Episode) -> None:
        """Writes an episode as a compressed npz that `numpy.load` reads without pickle, with its metadata as JSON.

        Raises a FileExistsError if there is one of its number: of several processes that write it, one succeeds. Raises
        a ValueError, with nothing written, if it could not be read again.
        """
        try:
            episode.check()
        except ValueError as error:
            raise ValueError(f"episode {episode.index} cannot be recorded: {error}") from error
        files.create_arrays(self._path(episode.index), episode.arrays, self._metadata(episode))

    def keep_aside(self, episode: Episode) -> Path:
        """Writes an episode whose number is taken to a file of its own, which is not among the episodes; returns it."""
        name = f"unsaved_{episode.index:06d}_{os.getpid()}_{secrets.token_hex(4)}.npz"
        return files.create_arrays(self.folder / name, episode.arrays, self._metadata(episode))

    def _metadata(self, episode: Episode) -> dict[str, Any]:
        summary = episode.summary
        metadata = _Metadata(
            episode=episode.index,
            seed=episode.seed,
            steps=episode.steps,
            total_reward=summary.total_reward,
            seconds=episode.seconds,
            results=episode.metrics,
            instruction=episode.instruction,
            actions_sha256=episode.actions_sha256,
            recording=self.spec.as_json(),
        )
        return vars(metadata)

    def remove(self, index: int) -> None:
        self._path(index).unlink(missing_ok=True)

    def __iter__(self) -> Iterator[Episode]:
        """Reads the episodes in the order of their numbers; raises as `load`."""
        return map(self.load, self.indices)

    def load(self, index: int) -> Episode:
        """Reads an episode; raises an OSError if it cannot be read, or is of another number or recording."""
        arrays, record = files.load_arrays(self._path(index), "an episode")
        about = self._parse(index, record)
        try:
            episode = Episode(
                index=index,
                seed=about.seed,
                arrays=NamedArrays(arrays),
                seconds=about.seconds,
                instruction=about.instruction,
                metrics=about.results,
            )
            episode.check(about.actions_sha256)
        except ValueError as error:
            raise OSError(f"{self._path(index)} does not hold an episode: {error}") from error
        return episode

    def load_transitions(self, indices: Iterable[int] | None = None) -> Transitions:
        """Reads the arrays of all control steps, one episode after the other, in the order of the numbers.

        Of `m` control steps of `e` episodes, the result has as NumPy arrays:
          `observations`: by key, `(m + e, ...)` in the types of the observation space; each episode has a row more
            than it has steps, that of its reset. A camera's picture is found by the camera's name as well.
          `rows`: `(m,)` int64, the row of the observation before each step; the next row was observed after it.
          `actions`: `(m, n)` float32, as they were applied; in recordings of `kitchen-rollout` float64.
          `rewards`: `(m,)` float64.
          `terminations`, `truncations`, `ends`: `(m,)` bool; `ends` is true at each last step of an episode.
          `last`: `(m,)` int64, the number of the last step of each step's episode.
          `indices`, `lengths`: `(e,)` int64, numbers of the episodes and of their steps.
          `arrays`: all of them, infos, physics states and labels by the names that an episode's arrays have.

        Args:
          indices: numbers of the episodes, such as `recording.successful`, in the order wanted; None for all.

        Raises as `load`, and a ValueError if there are no such episodes.
        """
        return Transitions.of(map(self.load, self.indices if indices is None else indices))

    def load_fitting(self, index: int, environment: gymnasium.Env) -> Episode:
        """Reads an episode for those who compute with it; raises as `load`.

        An OSError is raised as well unless observations and actions are in the spaces of the recording's environment.
        """
        episode = self.load(index)
        try:
            episode.check_fits(environment, is_partial=self.spec.origin is not None)
        except ValueError as error:
            raise OSError(f"{self._path(index)} does not hold an episode of its task: {error}") from error
        return episode

    def load_summary(self, index: int) -> Summary:
        """Reads the summary of an episode, and not its arrays; raises as `load`."""
        metadata = self._parse(index, files.load_metadata(self._path(index), "an episode"))
        return Summary(
            seed=metadata.seed,
            steps=metadata.steps,
            total_reward=metadata.total_reward,
            metrics=metadata.results,
            seconds=metadata.seconds,
        )

    def digest(self, indices: Iterable[int]) -> str:
        """Returns a SHA-256 of the names, types, shapes and contents of the arrays of some episodes, in their order."""
        digest = hashlib.sha256()
        for index in indices:
            self.load(index).update_digest(digest)
        return digest.hexdigest()

    def _parse(self, index: int, record: Mapping[str, Any]) -> _Metadata:
        """Returns an episode's metadata; raises an OSError if they are of another episode or recording."""
        path = self._path(index)
        try:
            metadata = files.parse(record, _Metadata, f"{path} does not hold an episode")
        except ValueError as error:
            raise OSError(str(error)) from error
        # An episode that another program recorded has no seed.
        seed = self.spec.seed_of(index) if self.spec.origin is None else None
        expected = (index, seed, self.spec.as_json())
        if (metadata.episode, metadata.seed, metadata.recording) != expected:
            raise OSError(f"{path} holds an episode of another number, seed or recording than its folder's")
        return metadata

    def _path(self, index: int) -> Path:
        return self.folder / _PATTERN.replace("*", f"{index:06d}")

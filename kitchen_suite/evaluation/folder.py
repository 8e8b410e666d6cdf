"""The folder of an evaluation: its description, a line of JSON for each finished episode, and the episodes' traces."""

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite import files
from kitchen_suite.evaluation.rollout import PlayedEpisode
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.traces import stacked, unstacked

DESCRIPTION_FILE = "evaluation.json"
EPISODES_FILE = "episodes.jsonl"
TRACES_FOLDER = "traces"

_EVALUATION = files.DescribedFolder(
    DESCRIPTION_FILE, "an evaluation", EPISODES_FILE, "resume it, or name another folder"
)

# A hundred thousand episodes take less [bytes].
_MAX_BYTES = 2**30

# Name of the condition, and number of the episode in it.
Key = tuple[str, int]


class EvaluationFolder:
    """Keeps the episodes of an evaluation, in a folder if there is one, so that an interrupted evaluation can go on.

    Attributes:
      played: result and trace of each finished episode.
    """

    def __init__(self, folder: Path | None, description: Mapping[str, Any]) -> None:
        """Begins without episodes, which are lost at the end where there is no folder; see `create` and `resume`."""
        self._folder = folder
        self._places = {name: place for place, name in enumerate(description["conditions"])}
        self.played: dict[Key, PlayedEpisode] = {}

    @classmethod
    def create(cls, folder: Path, description: Mapping[str, Any]) -> "EvaluationFolder":
        """Starts a new evaluation; of several processes that do so in one folder at the same time, one succeeds."""
        _EVALUATION.create(folder, description)
        return cls(folder, description)

    @classmethod
    def resume(cls, folder: Path, description: Mapping[str, Any]) -> "EvaluationFolder":
        """Continues an evaluation; a last line that a killed process left unfinished is removed."""
        _EVALUATION.resume(folder, _EVALUATION.load(folder), description)
        opened = cls(folder, description)
        path = folder / EPISODES_FILE
        if path.exists():
            opened._read(path)
        return opened

    def withdraw(self) -> None:
        """Removes the description from the folder if there is no result."""
        if self._folder and not self.played:
            # That of an episode without a line may be left by a killed process.
            with contextlib.suppress(OSError):
                (self._folder / TRACES_FOLDER).rmdir()
            _EVALUATION.withdraw(self._folder)

    def add(self, played: PlayedEpisode) -> None:
        """Adds an episode: first its trace, so that an episode with a line has one."""
        result = played.result
        if self._folder:
            path = self._trace_path(self._folder, result)
            with files.made_folder(path.parent):
                with files.atomic_write(path) as partial:
                    partial.write_bytes(files.pack_arrays(stacked([played.trace])))
                try:
                    _append(self._folder / EPISODES_FILE, files.json_text(result.as_json()))
                except OSError:
                    path.unlink()
                    raise
        self.played[result.condition, result.episode] = played

    def _trace_path(self, folder: Path, result: EpisodeResult) -> Path:
        """Returns the path of an episode's trace, by the place of its condition: names may hold any characters."""
        return folder / TRACES_FOLDER / f"{self._places[result.condition]:03d}_{result.episode:06d}.npz"

    def _read(self, path: Path) -> None:
        """Reads the finished episodes; raises an OSError for a line or a trace that holds something else."""
        with files.reading(path, "the episodes of an evaluation"):
            files.check_size(path.stat().st_size, _MAX_BYTES)
            *lines, torn = path.read_bytes().split(b"\n")
            results = [files.parse(files.parse_json(line), EpisodeResult, "not an episode's result") for line in lines]
            paths = [self._trace_path(path.parent, result) for result in results]
        for result, trace_path in zip(results, paths, strict=True):
            # An episode without a trace, which somebody has removed, is played again.
            if not trace_path.exists():
                continue
            with files.reading(trace_path, "the trace of an episode"), trace_path.open("rb") as file:
                (trace,) = unstacked(files.unpack_arrays(file), 1)
            self.played[result.condition, result.episode] = PlayedEpisode(result, trace)
        if torn:
            os.truncate(path, path.stat().st_size - len(torn))


def _append(path: Path, line: str) -> None:
    """Adds a line to a file, which need not exist; after an error the file is as it was."""
    size = path.stat().st_size if path.exists() else None
    try:
        with path.open("ab") as file:
            file.write(line.encode() + b"\n")
    except OSError as error:
        if size is None:
            path.unlink(missing_ok=True)
        else:
            os.truncate(path, size)
        # Python does not say which file could not be written to.
        error.filename = error.filename or str(path)
        raise

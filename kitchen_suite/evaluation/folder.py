"""The folder of an evaluation: its description, and a line of JSON for each finished episode."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite import files
from kitchen_suite.evaluation.scores import EpisodeResult

DESCRIPTION_FILE, EPISODES_FILE = "evaluation.json", "episodes.jsonl"
_EVALUATION = files.DescribedFolder(
    DESCRIPTION_FILE, "an evaluation", EPISODES_FILE, "resume it, or name another folder"
)

# Name of the condition, and number of the episode in it.
Key = tuple[str, int]


class EvaluationFolder:
    """Keeps the results of episodes, in a folder if there is one, so that an interrupted evaluation can go on."""

    def __init__(self, folder: Path | None = None) -> None:
        """Begins without results, which are lost at the end where there is no folder; see `create` and `resume`."""
        self._folder = folder
        self._path = folder and folder / EPISODES_FILE
        self._evaluation = files.file_digest(folder / DESCRIPTION_FILE) if folder else ""
        self.results: dict[Key, EpisodeResult] = {}

    @classmethod
    def create(cls, folder: Path, description: Mapping[str, Any]) -> "EvaluationFolder":
        """Starts a new evaluation; of several processes that do so in one folder at the same time, one succeeds."""
        _EVALUATION.create(folder, description)
        return cls(folder)

    @classmethod
    def resume(cls, folder: Path, description: Mapping[str, Any], seeds: Mapping[Key, int]) -> "EvaluationFolder":
        """Continues an evaluation of given seeds; a last line that a killed process left unfinished is removed."""
        _EVALUATION.resume(folder, _EVALUATION.load(folder), description)
        opened = cls(folder)
        opened._read(folder / EPISODES_FILE, seeds)
        return opened

    def withdraw(self) -> None:
        """Removes the description from the folder if there is no result."""
        if self._folder and not self.results:
            _EVALUATION.withdraw(self._folder)

    def add(self, result: EpisodeResult) -> None:
        if self._path:
            _append(self._path, result.as_line(self._evaluation) + b"\n")
        self.results[result.condition, result.episode] = result

    def _read(self, path: Path, seeds: Mapping[Key, int]) -> None:
        """Reads the lines of the finished episodes; raises an OSError for a line that holds something else."""
        if not path.exists():
            return
        with files.reading(path, "the episodes of an evaluation"):
            # A hundred thousand episodes take less.
            files.check_size(path.stat().st_size, 2**30)
            *lines, torn = path.read_bytes().split(b"\n")
            for number, line in enumerate(lines, start=1):
                try:
                    result = EpisodeResult.from_line(line, self._evaluation)
                except ValueError as error:
                    raise ValueError(f"line {number}: {error}") from error
                key = result.condition, result.episode
                if seeds.get(key) != result.seed:
                    raise ValueError(f"line {number} is not of this evaluation: {key}, seed {result.seed}")
                self.results[key] = result
        if torn:
            os.truncate(path, path.stat().st_size - len(torn))


def _append(path: Path, line: bytes) -> None:
    """Adds a line to a file, which need not exist; after an error the file is as it was."""
    size = path.stat().st_size if path.exists() else None
    try:
        with path.open("ab") as file:
            file.write(line)
    except OSError as error:
        if size is None:
            path.unlink(missing_ok=True)
        else:
            os.truncate(path, size)
        # Python does not say which file could not be written to.
        error.filename = error.filename or str(path)
        raise

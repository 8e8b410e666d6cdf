"""A folder in which a recording grows: one file an episode, each whole or absent, and what they are made of."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kitchen_suite import files
from kitchen_suite.recordings.spec import RecordingSpec
from kitchen_suite.rollouts import episode_files
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays

SPEC_FILE = "episode_files.json"


class RecordingFolder:
    """The folder of one recording."""

    def __init__(self, folder: Path, recipe: RecordingSpec) -> None:
        """Names the folder; see `claim` and `open`."""
        self._folder, self._recipe = folder, recipe

    @classmethod
    def claim(cls, folder: Path, recipe: RecordingSpec) -> "RecordingFolder":
        """Makes a folder ready for a recording, or for what an interrupted one still lacks.

        Raises:
          OSError: it cannot be made or written to, or it holds other episodes.
          ValueError: it holds a recording of something else.
        """
        if (folder / SPEC_FILE).exists():
            present = cls.open(folder)
            _check_same(folder, present.recipe.record(), recipe.record())
            files.check_writable(folder)
            files.sweep(folder)
            return present
        episode_files.claim_folder(folder)
        with files.whole_file(folder / SPEC_FILE) as partial:
            partial.write_text(json.dumps(recipe.record(), indent=2) + "\n", encoding="utf-8")
        return cls(folder, recipe)

    @classmethod
    def open(cls, folder: Path) -> "RecordingFolder":
        """Opens what is there.

        Raises:
          OSError: there is no recording.
          ValueError: what should describe it does not.
        """
        path = folder / SPEC_FILE
        try:
            return cls(folder, RecordingSpec.of(json.loads(path.read_text(encoding="utf-8"))))
        except ValueError as error:
            raise ValueError(f"{path} does not describe a recording: {error}") from error

    @property
    def folder(self) -> Path:
        """Where it is."""
        return self._folder

    @property
    def recipe(self) -> RecordingSpec:
        """What its episodes are made of."""
        return self._recipe

    @property
    def indices(self) -> list[int]:
        """Numbers of the episodes that are there, in order."""
        return episode_files.episode_indices(self._folder)

    def save(self, episode: EpisodeArrays, results: Mapping[str, Any]) -> None:
        """Writes an episode, and what came of it."""
        known = {
            "episode": episode.index,
            "seed": episode.seed,
            "steps": episode.steps,
            "total_reward": float(episode.arrays["reward"].sum()),
            "seconds": episode.seconds,
            "results": results,
            "recording": self._recipe.record(),
        }
        files.save_arrays(episode_files.episode_path(self._folder, episode.index), episode.arrays, known)

    def load(self, index: int) -> EpisodeArrays:
        """Reads an episode."""
        arrays, known = files.load_arrays(episode_files.episode_path(self._folder, index))
        return EpisodeArrays(index=index, seed=known["seed"], arrays=arrays, seconds=known["seconds"])

    def outcome(self, index: int) -> dict[str, Any]:
        """Reads what came of an episode, and nothing else of it."""
        return files.load_metadata(episode_files.episode_path(self._folder, index))


def _check_same(folder: Path, present: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raises a ValueError that names what differs."""
    for name, value in present.items():
        if value != wanted[name]:
            raise ValueError(
                f"{folder} holds a recording with {name} {json.dumps(value)}, not {json.dumps(wanted[name])}: "
                "name another folder"
            )

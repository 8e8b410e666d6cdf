"""Sources of episodes to replay: folders of `kitchen-record` and `kitchen-rollout`, and datasets of all formats."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium

from kitchen_suite.recordings.formats import FORMATS, Source
from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.rollouts.folder import SPEC_FILE, RecordingFolder
from kitchen_suite.rollouts.spec import EpisodeSpec


class FolderSource(Source):
    """A folder of `kitchen-record` or `kitchen-rollout`."""

    def __init__(self, folder: Path) -> None:
        """Opens the folder; raises what `RecordingFolder.open` does.

        Raises:
          ValueError: other programs recorded the episodes.
        """
        self._folder = RecordingFolder.open(folder)
        if self.spec.origin is not None:
            raise ValueError(f"{folder} was made by kitchen-convert, and holds no states from which to replay")

    @property
    def spec(self) -> EpisodeSpec:
        return self._folder.spec

    @property
    def indices(self) -> Sequence[int]:
        return self._folder.indices

    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        return self.spec.make_environment(**rendering)

    def load(self, index: int) -> EpisodeArrays:
        return self._folder.load(index)


def find(name: str, root: Path | None = None) -> Source:
    """Returns the recording in a folder, or the dataset of a name or in a folder.

    Args:
      name: of the folder or the dataset.
      root: folder of LeRobot's datasets; its own when omitted.

    Raises:
      ImportError: it may be a dataset, but the library of its format is not installed.
      OSError: there is none, or it cannot be read.
      ValueError: the folder holds something else.
    """
    folder = Path(name)
    if (folder / SPEC_FILE).is_file():
        return FolderSource(folder)
    for each in FORMATS.values():
        if source := each.find(name, root):
            return source
    titles = " or ".join(each.title for each in FORMATS.values())
    if folder.exists():
        hint = f": name its folder, {folder.parent}" if (folder.parent / SPEC_FILE).is_file() else ""
        raise ValueError(f"{name} holds neither {SPEC_FILE} nor a {titles} dataset{hint}")
    raise FileNotFoundError(
        f"there is no folder {name}, and no {titles} dataset of that name on this machine; `minari download` gets "
        "datasets of Minari, whose names end in -v0"
    )

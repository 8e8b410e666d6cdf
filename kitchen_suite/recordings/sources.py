"""Sources of episodes to replay: folders of `kitchen-record` and `kitchen-rollout`, Minari and LeRobot datasets."""

import abc
import contextlib
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, gymnasium_env
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings import lerobot_dataset
from kitchen_suite.recordings.lerobot_columns import LeRobotObservations
from kitchen_suite.recordings.minari_dataset import (
    INSTRUCTION_KEY,
    SPEC_KEY,
    absolute_root,
    check_id,
    check_size,
    import_minari,
)
from kitchen_suite.rollouts.episode import EpisodeArrays, flatten
from kitchen_suite.rollouts.folder import SPEC_FILE, RecordingFolder
from kitchen_suite.rollouts.spec import RecordingSpec

# End of the name of a Minari dataset.
_DATASET_ID = re.compile(r"-v\d+$")

# Of Gymnasium-Robotics; the datasets D4RL/kitchen/*-v2 are recordings of it.
_ORIGINAL_ID = "FrankaKitchen-v1"


class Source(abc.ABC):
    """Episodes, and the environment that they were recorded in."""

    @property
    @abc.abstractmethod
    def spec(self) -> RecordingSpec | None:
        """The specification of the episodes; None where another program recorded them."""

    @property
    @abc.abstractmethod
    def indices(self) -> Sequence[int]:
        """Numbers of the episodes, in order."""

    @abc.abstractmethod
    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        """Makes the environment, with arguments of its rendering such as `visuals`."""

    @abc.abstractmethod
    def load(self, index: int) -> EpisodeArrays:
        """Reads an episode."""

    def projected(self, replayed: EpisodeArrays) -> EpisodeArrays:
        """Returns a replayed episode with the arrays that the source holds of an episode."""
        return replayed


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
    def spec(self) -> RecordingSpec:
        return self._folder.spec

    @property
    def indices(self) -> Sequence[int]:
        return self._folder.indices

    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        return self.spec.make_environment(**rendering)

    def load(self, index: int) -> EpisodeArrays:
        return self._folder.load(index)


class MinariSource(Source):
    """A Minari dataset of the suite's environments, or of Gymnasium-Robotics' kitchen."""

    def __init__(self, dataset: Any) -> None:
        """Takes a dataset that Minari has loaded.

        Raises:
          OSError: its metadata cannot be read.
          ValueError: the dataset is of another environment.
        """
        self._dataset = dataset
        with self._reading("the metadata of a dataset"):
            spec = dataset.storage.metadata.get(SPEC_KEY)
            self._spec = None if spec is None else RecordingSpec.from_json(spec)
            self._env_spec = dataset.env_spec
        found = self._env_spec and self._env_spec.id
        if found not in (_ORIGINAL_ID, *gymnasium_env.IDS.values(), *gymnasium_env.TASK_IDS.values()):
            raise ValueError(f"dataset {dataset.id} is not of a domain of the suite, but of {found}")

    @property
    def spec(self) -> RecordingSpec | None:
        return self._spec

    @property
    def indices(self) -> Sequence[int]:
        return range(self._dataset.total_episodes)

    @property
    def is_original(self) -> bool:
        """Whether the dataset is of Gymnasium-Robotics' kitchen."""
        return self._env_spec.id == _ORIGINAL_ID

    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        env_spec = self._env_spec
        env_id = gymnasium_env.KITCHEN_ID if self.is_original else env_spec.id
        arguments = {name: value for name, value in env_spec.kwargs.items() if name != "render_mode"}
        # -1: no limit.
        limit = env_spec.max_episode_steps or -1
        return gymnasium.make(env_id, max_episode_steps=limit, **{**rendering, **arguments})

    def load(self, index: int) -> EpisodeArrays:
        with self._reading(f"episode {index}"):
            check_size(self._dataset.storage.data_path, index)
            (data,) = self._dataset.iterate_episodes([index])
            (metadata,) = self._dataset.storage.get_episode_metadata([index])
            arrays = {
                **flatten(data.observations, "observation"),
                **_numeric(data.infos or {}, len(data.rewards) + 1),
                "action": data.actions,
                "reward": data.rewards,
                "termination": data.terminations,
                "truncation": data.truncations,
            }
            seed = metadata.get("seed")
            episode = EpisodeArrays(
                index=index,
                seed=None if seed is None else int(seed),
                arrays=arrays,
                instruction=str(metadata.get(INSTRUCTION_KEY, "")),
            )
            episode.check()
        return episode

    def _reading(self, what: str) -> contextlib.AbstractContextManager[None]:
        return files.reading(self._dataset.storage.data_path, what)


class LeRobotSource(Source):
    """A LeRobot dataset of `kitchen-record`."""

    def __init__(self, folder: Path) -> None:
        """Opens the dataset; raises what `LeRobotEpisodes` does."""
        self._episodes = lerobot_dataset.LeRobotEpisodes(folder)

    @property
    def spec(self) -> RecordingSpec:
        return self._episodes.spec

    @property
    def indices(self) -> Sequence[int]:
        return self._episodes.indices

    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        environment = self.spec.make_environment(**rendering)
        self._observations = LeRobotObservations(suite_env(environment))
        return environment

    def load(self, index: int) -> EpisodeArrays:
        return self._episodes.load(index, self._observations)

    def projected(self, replayed: EpisodeArrays) -> EpisodeArrays:
        return self._observations.projected(replayed)


def _numeric(infos: Mapping[str, Any], rows: int) -> dict[str, NDArray]:
    """Returns the arrays of numbers with `rows` rows: other programs also keep strings, or lack the reset's infos."""
    arrays = {name: np.asarray(array) for name, array in flatten(infos, "info").items()}
    return {name: array for name, array in arrays.items() if array.dtype.kind in "biuf" and array.shape[:1] == (rows,)}


def find(name: str, root: Path | None = None) -> Source:
    """Returns the recording in a folder, or the Minari or LeRobot dataset of a name or in a folder.

    Args:
      name: of the folder or the dataset.
      root: folder of LeRobot's datasets; its own when omitted.

    Raises:
      ImportError: it may be a dataset, but the library of its format is not installed.
      OSError: there is none, or it cannot be read.
      ValueError: the folder holds something else.
    """
    folder, home = Path(name), lerobot_dataset.home(root)
    if (folder / SPEC_FILE).is_file():
        return FolderSource(folder)
    for data in (folder, folder / "data"):
        if (data / "metadata.json").is_file():
            return MinariSource(_load_dataset(import_minari().MinariDataset, data))
    for dataset in (folder, home / name):
        if (dataset / lerobot_dataset.INFO_FILE).is_file():
            return LeRobotSource(dataset)
    if folder.exists():
        hint = f": name its folder, {folder.parent}" if (folder.parent / SPEC_FILE).is_file() else ""
        raise ValueError(f"{name} holds neither {SPEC_FILE} nor a Minari or LeRobot dataset{hint}")
    if not _DATASET_ID.search(name):
        raise FileNotFoundError(
            f"there is no folder {name}, no LeRobot dataset of that name in {home}, and no Minari dataset has such a "
            "name (they end in -v0)"
        )
    minari = import_minari()
    check_id(name)
    if not (absolute_root() / name / "data").exists():
        raise FileNotFoundError(
            f"there is neither a folder {name} nor a local Minari dataset of that name; `minari download` gets others"
        )
    return MinariSource(_load_dataset(minari.load_dataset, name))


def _load_dataset(load: Callable[[Any], Any], name: str | Path) -> Any:
    """Loads a dataset; raises an OSError if it is damaged."""
    with files.reading(Path(name), "a Minari dataset"):
        return load(name)

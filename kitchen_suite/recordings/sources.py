"""What there is to be played again: folders of `kitchen-record`, and Minari datasets."""

import abc
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium

from kitchen_suite import gymnasium_env
from kitchen_suite.recordings.folder import SPEC_FILE, RecordingFolder
from kitchen_suite.recordings.minari_dataset import SPEC_KEY, check_id, minari
from kitchen_suite.recordings.spec import RecordingSpec
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays, flatten

# Of Gymnasium-Robotics; the datasets D4RL/kitchen/*-v2 are recordings of it.
_ORIGINAL_ID = "FrankaKitchen-v1"


class Recording(abc.ABC):
    """Episodes, and the environment that they are to be played in again."""

    @property
    @abc.abstractmethod
    def recipe(self) -> RecordingSpec | None:
        """What it is made of; None where `kitchen-record` has not made it."""

    @property
    @abc.abstractmethod
    def indices(self) -> Sequence[int]:
        """Numbers of its episodes, in order."""

    @abc.abstractmethod
    def environment(self, *, visuals: bool) -> gymnasium.Env:
        """Makes the environment; with visuals for pictures."""

    @abc.abstractmethod
    def episode(self, index: int) -> EpisodeArrays:
        """Reads an episode."""


class StagedRecording(Recording):
    """A folder of `kitchen-record`."""

    def __init__(self, folder: Path) -> None:
        """Opens it; raises what `RecordingFolder.open` does."""
        self._staging = RecordingFolder.open(folder)

    @property
    def recipe(self) -> RecordingSpec:
        return self._staging.recipe

    @property
    def indices(self) -> Sequence[int]:
        return self._staging.indices

    def environment(self, *, visuals: bool) -> gymnasium.Env:
        return self.recipe.environment(visuals=visuals)

    def episode(self, index: int) -> EpisodeArrays:
        return self._staging.load(index)


class MinariRecording(Recording):
    """A Minari dataset of the suite's environments, or of Gymnasium-Robotics' kitchen."""

    def __init__(self, dataset: Any) -> None:
        """Takes a dataset that Minari has loaded.

        Raises:
          ValueError: it is of another environment.
        """
        self._dataset = dataset
        recipe = dataset.storage.metadata.get(SPEC_KEY)
        self._recipe = None if recipe is None else RecordingSpec.of(recipe)
        spec = dataset.env_spec
        if spec is None or spec.id not in (_ORIGINAL_ID, gymnasium_env.KITCHEN_ID, gymnasium_env.CABINET_ID):
            raise ValueError(f"dataset {dataset.id} is not of a kitchen or cabinet, but of {spec and spec.id}")
        self._spec = spec

    @property
    def recipe(self) -> RecordingSpec | None:
        return self._recipe

    @property
    def indices(self) -> Sequence[int]:
        return range(self._dataset.total_episodes)

    def environment(self, *, visuals: bool) -> gymnasium.Env:
        ours = gymnasium_env.KITCHEN_ID if self._spec.id == _ORIGINAL_ID else self._spec.id
        arguments = {name: value for name, value in self._spec.kwargs.items() if name != "render_mode"}
        # -1: no limit.
        limit = self._spec.max_episode_steps or -1
        return gymnasium.make(ours, max_episode_steps=limit, **{**arguments, "visuals": visuals})

    def episode(self, index: int) -> EpisodeArrays:
        (data,) = self._dataset.iterate_episodes([index])
        (about,) = self._dataset.storage.get_episode_metadata([index])
        arrays = {
            **flatten(data.observations, "observation"),
            **(flatten(data.infos, "info") if data.infos else {}),
            "action": data.actions,
            "reward": data.rewards,
            "termination": data.terminations,
            "truncation": data.truncations,
        }
        return EpisodeArrays(index=index, seed=about.get("seed"), arrays=arrays)


def find(name: str) -> Recording:
    """Opens a recording by its folder, or a Minari dataset by its id or folder.

    Raises:
      ImportError: it may be a dataset, but Minari is missing.
      OSError: there is none.
      ValueError: what is there is something else.
    """
    folder = Path(name)
    if (folder / SPEC_FILE).is_file():
        return StagedRecording(folder)
    module = minari()
    for data in (folder, folder / "data"):
        if (data / "metadata.json").is_file():
            return MinariRecording(module.MinariDataset(data))
    if folder.exists():
        raise ValueError(f"{name} holds neither {SPEC_FILE} nor a Minari dataset")
    check_id(name)
    try:
        return MinariRecording(module.load_dataset(name))
    except FileNotFoundError as error:
        raise FileNotFoundError(
            f"there is neither a folder {name} nor here a Minari dataset of that name; minari download gets others"
        ) from error

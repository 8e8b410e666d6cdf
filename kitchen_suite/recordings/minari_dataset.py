"""Recordings as Minari datasets, each whole or absent. Needs the extra `record`."""

import contextlib
import importlib
import os
import shutil
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium

from kitchen_suite import files
from kitchen_suite.recordings.folder import RecordingFolder
from kitchen_suite.recordings.minari_root import datasets_in
from kitchen_suite.recordings.spec import RecordingSpec
from kitchen_suite.rollouts.episode_arrays import EpisodeArrays, nested

# Where the dataset's metadata has the recipe, and how many episodes were asked for.
SPEC_KEY = "kitchen_suite_recording"
_COUNT_KEY = "kitchen_suite_num_episodes"

# HDF5 keeps seeds in attributes of 64 bits.
_MOST_SEED = 2**63 - 1
# Episodes that are in memory at the same time.
_CHUNK = 20


class DatasetPlan:
    """A dataset that is to hold the first episodes of a recording."""

    def __init__(self, dataset_id: str, recipe: RecordingSpec, count: int) -> None:
        """Plans it.

        Raises:
          ImportError: Minari is missing.
          ValueError: the id is malformed, its place is taken by something else, or a seed is too large.
        """
        self._minari = minari()
        self._dataset_id, self._recipe, self._count = dataset_id, recipe, count
        check_id(dataset_id)
        if recipe.seed + count - 1 > _MOST_SEED:
            raise ValueError(f"seeds in a dataset may not exceed {_MOST_SEED}, got {recipe.seed + count - 1}")
        self._check_free()

    @property
    def dataset_id(self) -> str:
        """Its name in Minari."""
        return self._dataset_id

    @property
    def path(self) -> Path:
        """Where it is, or will be."""
        return _root() / self._dataset_id

    @property
    def is_missing(self) -> bool:
        """Whether it has still to be made."""
        return not self.path.exists()

    def make(self, environment: gymnasium.Env, staging: RecordingFolder, indices: Sequence[int]) -> None:
        """Makes it of episodes that are in a recording's folder.

        Args:
          environment: what it will recover.
          staging: the folder.
          indices: the episodes.
        """
        with self._whole():
            dataset = self._create(environment)
            for start in range(0, len(indices), _CHUNK):
                chunk = [self._buffer(staging.load(index)) for index in indices[start : start + _CHUNK]]
                dataset.update_dataset_from_buffer(chunk)
            dataset.storage.update_metadata({SPEC_KEY: self._recipe.record(), _COUNT_KEY: self._count})

    def _check_free(self) -> None:
        if self.is_missing:
            return
        present = self._minari.load_dataset(self._dataset_id).storage.metadata
        if present.get(SPEC_KEY) != self._recipe.record():
            raise ValueError(f"dataset {self._dataset_id!r} exists and holds another recording: name another one")
        if present.get(_COUNT_KEY) != self._count:
            raise ValueError(
                f"dataset {self._dataset_id!r} exists and is of the first {present.get(_COUNT_KEY)} episodes of this "
                f"recording, not of {self._count}: name another one"
            )

    @contextlib.contextmanager
    def _whole(self) -> Iterator[None]:
        """Lets Minari write elsewhere; what it wrote becomes the dataset if all went well."""
        root = _root()
        files.sweep(root)
        elsewhere = files.partial_path(root / "kitchen-record")
        try:
            with datasets_in(elsewhere):
                yield
            if "/" in self._dataset_id:
                self._make_namespace(self._dataset_id.rpartition("/")[0])
            os.rename(elsewhere / self._dataset_id, self.path)
        finally:
            shutil.rmtree(elsewhere, ignore_errors=True)

    def _make_namespace(self, namespace: str) -> None:
        if namespace not in self._minari.namespace.list_local_namespaces():
            self._minari.namespace.create_namespace(namespace)

    def _create(self, environment: gymnasium.Env) -> Any:
        """Makes a dataset without episodes."""
        recipe = self._recipe
        with warnings.catch_warnings():
            # Of author, permalink and another environment for evaluation, which it would like to be told.
            warnings.filterwarnings("ignore", r"`\w+` is set to None")
            return self._minari.create_dataset_from_buffers(
                self._dataset_id,
                [],
                env=environment,
                algorithm_name=recipe.policy,
                description=f"Policy {recipe.policy} in task {recipe.task_name} of domain {recipe.domain_name}; "
                "reset with an episode's seed, the recovered environment plays it again.",
                # Another version computes other last bits.
                requirements=[f"mujoco=={recipe.versions['mujoco']}"],
            )

    def _buffer(self, episode: EpisodeArrays) -> Any:
        arrays = episode.arrays
        infos = {name.removeprefix("info/"): array for name, array in arrays.items() if name.startswith("info/")}
        return self._minari.data_collector.EpisodeBuffer(
            seed=episode.seed,
            observations=nested(arrays, "observation"),
            actions=arrays["action"],
            rewards=arrays["reward"],
            terminations=arrays["termination"],
            truncations=arrays["truncation"],
            infos=infos,
        )


def minari() -> Any:
    """The module of that name.

    Raises:
      ImportError: it, or what it needs to read HDF5, is missing.
    """
    try:
        importlib.import_module("h5py")
        return importlib.import_module("minari")
    except ImportError as error:
        raise ImportError(f"a dataset needs Minari ({error}): pip install 'kitchen-suite[record]'") from error


def check_id(dataset_id: str) -> None:
    """Sees to it that Minari can name a dataset so.

    Raises:
      ValueError: it cannot.
    """
    parse = importlib.import_module("minari.dataset.minari_dataset").parse_dataset_id
    try:
        parse(dataset_id)
    except (TypeError, ValueError) as error:  # It fails to make a number of a version that is missing.
        raise ValueError(f"{dataset_id!r} is no name of a dataset, such as kitchen-suite/complete-expert-v0") from error


def _root() -> Path:
    # Minari mistakes where its files are if that is relative.
    return Path(importlib.import_module("minari.storage.datasets_root_dir").get_dataset_path()).absolute()

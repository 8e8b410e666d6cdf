"""Recordings as Minari datasets, each written atomically. Needs the extra `record`."""

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
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings.datasets import DatasetPlan
from kitchen_suite.rollouts.episode import EpisodeArrays, unflatten
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.rollouts.spec import RecordingSpec

# Keys of the dataset's metadata: the specification of the recording, and the number of episodes asked for.
SPEC_KEY = "kitchen_suite_recording"
_COUNT_KEY = "kitchen_suite_num_episodes"

# Key of the task's sentence in the metadata of an episode.
INSTRUCTION_KEY = "instruction"

# HDF5 keeps seeds in attributes of 64 bits.
_MAX_SEED = 2**63 - 1
# Number of episodes in memory at the same time.
_CHUNK = 20

# Dimensions of a camera's pictures: time, height, width, channels.
_PICTURES_NDIM = 4
# Name of Minari's file of all episodes.
_DATA_FILE = "main_data.hdf5"

_ROOT_VARIABLE = "MINARI_DATASETS_PATH"


class MinariPlan(DatasetPlan):
    """A Minari dataset; its name ends in a version, such as `-v0`."""

    def __init__(self, dataset_id: str, spec: RecordingSpec, count: int, root: Path | None = None) -> None:
        super().__init__(dataset_id, spec, count, root)
        self._minari = import_minari()
        check_id(dataset_id)
        if spec.seed + count - 1 > _MAX_SEED:
            raise ValueError(f"seeds in a dataset may not exceed {_MAX_SEED}, got {spec.seed + count - 1}")
        if not self.is_missing:
            with minari_root(root), files.reading(self.path, "a Minari dataset"):
                metadata = self._minari.load_dataset(dataset_id).storage.metadata
            self._check_same(metadata.get(SPEC_KEY), metadata.get(_COUNT_KEY))

    @property
    def path(self) -> Path:
        with minari_root(self._root):
            return absolute_root() / self.dataset_id

    def make(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        has_pictures = suite_env(environment).observations.has_pictures
        with minari_root(self._root), self._write_elsewhere():
            # Minari's JPEG would change pictures.
            dataset = self._create(environment, **({"jpeg_encoding": False} if has_pictures else {}))
            for start in range(0, len(indices), _CHUNK):
                episodes = [folder.load(index) for index in indices[start : start + _CHUNK]]
                dataset.update_dataset_from_buffer([self._buffer(episode) for episode in episodes])
                metadata = [{INSTRUCTION_KEY: episode.instruction} for episode in episodes]
                dataset.storage.update_episode_metadata(metadata, range(start, start + len(episodes)))
            if has_pictures:
                _compress(dataset.storage.data_path / _DATA_FILE)
                dataset.storage.update_metadata({"dataset_size": dataset.storage.get_size()})
            dataset.storage.update_metadata({SPEC_KEY: self.spec.as_json(), _COUNT_KEY: self.count})

    @contextlib.contextmanager
    def _write_elsewhere(self) -> Iterator[None]:
        """Lets Minari write to a hidden folder, which becomes the dataset if nothing fails."""
        root = absolute_root()
        files.remove_stale_partials(root)
        elsewhere = files.partial_path(root / "kitchen-record")
        try:
            with minari_root(elsewhere):
                yield
            if "/" in self.dataset_id:
                self._make_namespace(self.dataset_id.rpartition("/")[0])
            os.rename(elsewhere / self.dataset_id, root / self.dataset_id)
        finally:
            shutil.rmtree(elsewhere, ignore_errors=True)

    def _make_namespace(self, namespace: str) -> None:
        if namespace not in self._minari.namespace.list_local_namespaces():
            self._minari.namespace.create_namespace(namespace)

    def _create(self, environment: gymnasium.Env, **options: Any) -> Any:
        """Returns a new dataset without episodes; `options` are further ones of Minari."""
        spec = self.spec
        with warnings.catch_warnings():
            # About optional metadata: author, permalink, and another environment for evaluation.
            warnings.filterwarnings("ignore", r"`\w+` is set to None")
            return self._minari.create_dataset_from_buffers(
                self.dataset_id,
                [],
                env=environment,
                algorithm_name=spec.policy,
                description=f"Policy {spec.policy} in task {spec.task_name} of domain {spec.domain_name}; "
                "reset with an episode's seed, the recovered environment plays it again.",
                # Another version computes other last bits.
                requirements=[f"mujoco=={spec.versions['mujoco']}"],
                **options,
            )

    def _buffer(self, episode: EpisodeArrays) -> Any:
        arrays = episode.arrays
        return self._minari.data_collector.EpisodeBuffer(
            seed=episode.seed,
            observations=unflatten(arrays, "observation"),
            actions=arrays["action"],
            rewards=arrays["reward"],
            terminations=arrays["termination"],
            truncations=arrays["truncation"],
            infos={name.removeprefix("info/"): array for name, array in arrays.items() if name.startswith("info/")},
        )


def _compress(path: Path) -> None:
    """Compresses the pictures in an HDF5 file, each by itself and without loss; readers need not know."""
    h5py, compressed = importlib.import_module("h5py"), path.with_suffix(".compressed")
    with h5py.File(path, "r") as source, h5py.File(compressed, "w") as target:

        def copy(name: str, item: Any) -> None:
            if isinstance(item, h5py.Group):
                made = target.create_group(name)
            elif item.ndim < _PICTURES_NDIM:
                source.copy(item, target, name)
                return
            else:
                options = {"chunks": (1, *item.shape[1:]), "compression": "gzip", "shuffle": True}
                made = target.create_dataset(name, data=item[()], maxshape=item.maxshape, **options)
            made.attrs.update(item.attrs)

        source.visititems(copy)
        target.attrs.update(source.attrs)
    os.replace(compressed, path)


@contextlib.contextmanager
def minari_root(path: Path | None) -> Iterator[None]:
    """Sets the folder in which Minari finds and writes datasets; with None it stays Minari's own."""
    before = os.environ.get(_ROOT_VARIABLE)
    if path is not None:
        os.environ[_ROOT_VARIABLE] = os.path.abspath(path)
    try:
        yield
    finally:
        os.environ.pop(_ROOT_VARIABLE, None)
        os.environ.update({} if before is None else {_ROOT_VARIABLE: before})


def import_minari() -> Any:
    """Returns the module.

    Raises:
      ImportError: Minari, or what it reads HDF5 with, is not installed.
    """
    try:
        importlib.import_module("h5py")
        return importlib.import_module("minari")
    except ImportError as error:
        raise ImportError(f"a dataset needs Minari ({error}): pip install 'kitchen-suite[record]'") from error


def check_id(dataset_id: str) -> None:
    """Checks the name of a dataset.

    Raises:
      ValueError: Minari does not accept it.
    """
    parse = importlib.import_module("minari.dataset.minari_dataset").parse_dataset_id
    try:
        parse(dataset_id)
    except (TypeError, ValueError) as error:  # A missing version is a TypeError.
        raise ValueError(f"{dataset_id!r} is no name of a dataset, such as kitchen-suite/complete-expert-v0") from error


def check_size(data_path: Path, index: int) -> None:
    """Checks that an episode in HDF5 declares no more than `files.MAX_ARRAY_BYTES`, before it is read.

    Raises:
      OSError: the episode declares more, or the file cannot be read.
    """
    path = data_path / _DATA_FILE
    if not path.exists():  # Minari's other formats.
        return
    h5py, sizes = importlib.import_module("h5py"), []
    with h5py.File(path, "r") as file:
        file[f"episode_{index}"].visititems(lambda name, item: sizes.append(getattr(item, "nbytes", 0)))
    files.check_size(sum(sizes), files.MAX_ARRAY_BYTES)


def absolute_root() -> Path:
    """Returns the folder of all local datasets."""
    # With a relative root, Minari looks for its files in the wrong folder.
    return Path(importlib.import_module("minari.storage.datasets_root_dir").get_dataset_path()).absolute()

"""Recordings as Minari datasets, each written atomically. Needs the extra `record`."""

import contextlib
import importlib
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from kitchen_suite import checks, files, gymnasium_env
from kitchen_suite.datasets.formats import DatasetPlan, Source
from kitchen_suite.episodes.episode import EpisodeArrays, flatten, unflatten
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.tasks.policy_inputs import PICTURE_AXES

# Keys of the metadata of a dataset, the specification of the recording and the number of episodes asked for; and of
# those of an episode: the task's sentence, the digest of the actions, and the names of their labels, after commas.
SPEC_KEY, _COUNT_KEY = "kitchen_suite_recording", "kitchen_suite_num_episodes"
_EPISODE_KEYS = INSTRUCTION_KEY, _ACTIONS_KEY, _LABELS_KEY = "instruction", "actions_sha256", "kitchen_suite_labels"

_CHUNK = 20  # Number of episodes in memory at the same time.

# Minari's file of all episodes. Greatest sizes of an empty dataset, and of an array beside its elements [bytes].
_DATA_FILE = "main_data.hdf5"
_EMPTY_BYTES, _ARRAY_BYTES = 2**16, 2**13

_ORIGINAL_ID = "FrankaKitchen-v1"  # Of Gymnasium-Robotics; the datasets D4RL/kitchen/*-v2 are recordings of it.

_ROOT_VARIABLE = "MINARI_DATASETS_PATH"


class MinariPlan(DatasetPlan):
    """A Minari dataset; its name ends in a version, such as `-v0`."""

    def __init__(self, dataset_id: str, spec: EpisodeSpec, count: int, root: Path | None = None) -> None:
        super().__init__(dataset_id, spec, count, root)
        self._minari = import_minari()
        check_id(dataset_id)
        with minari_root(root):
            self.path = absolute_root() / dataset_id
        if not self.is_missing:
            with minari_root(root), files.reading(self.path, "a Minari dataset"):
                metadata = self._minari.load_dataset(dataset_id).storage.metadata
            self._check_same(metadata.get(SPEC_KEY), metadata.get(_COUNT_KEY))

    @property
    def seeds(self) -> list[int | None]:
        with minari_root(self._root), files.reading(self.path, "a Minari dataset"):
            storage = self._minari.load_dataset(self.dataset_id).storage
            return [about.get("seed") for about in storage.get_episode_metadata(range(storage.total_episodes))]

    def make(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        has_pictures = suite_env(environment).observations.has_pictures
        with minari_root(self._root), self._write_elsewhere():
            # Minari's JPEG would change pictures.
            dataset = self._create(environment, **({"jpeg_encoding": False} if has_pictures else {}))
            data_file = dataset.storage.data_path / _DATA_FILE
            for start in range(0, len(indices), _CHUNK):
                episodes = [folder.load(index) for index in indices[start : start + _CHUNK]]
                # Half of a chunk may be empty. HDF5 cuts off at the end what it has not used.
                arrays = [array for episode in episodes for array in episode.arrays.values()]
                files.reserve(data_file, sum(_ARRAY_BYTES + 2 * array.nbytes for array in arrays))
                dataset.update_dataset_from_buffer([self._buffer(episode) for episode in episodes])
                rows = [(each.instruction, each.actions_sha256, ",".join(each.labels)) for each in episodes]
                metadata = [{key: text for key, text in zip(_EPISODE_KEYS, row, strict=True) if text} for row in rows]
                dataset.storage.update_episode_metadata(metadata, range(start, start + len(episodes)))
            if has_pictures:
                _compress(data_file)
                dataset.storage.update_metadata({"dataset_size": dataset.storage.get_size()})
            dataset.storage.update_metadata({SPEC_KEY: self.spec.as_json(), _COUNT_KEY: self.count})

    @contextlib.contextmanager
    def _write_elsewhere(self) -> Iterator[None]:
        """Lets Minari write to a hidden folder, which becomes the dataset if nothing fails."""
        root = absolute_root()
        with files.temporary_folder(root / "kitchen-record") as elsewhere:
            elsewhere.mkdir()
            files.reserve(elsewhere / _DATA_FILE, _EMPTY_BYTES)
            (elsewhere / _DATA_FILE).unlink()
            with minari_root(elsewhere):
                yield
            namespace, api = self.dataset_id.rpartition("/")[0], self._minari.namespace
            if namespace and namespace not in api.list_local_namespaces():
                api.create_namespace(namespace)
            os.rename(elsewhere / self.dataset_id, root / self.dataset_id)

    def _create(self, environment: gymnasium.Env, **options: Any) -> Any:
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
            # Labels of actions are infos of the steps that they make, 0 at the reset, as in gym-hil.
            infos={
                **{name.removeprefix("info/"): array for name, array in arrays.items() if name.startswith("info/")},
                **{
                    name.removeprefix("label/"): np.concatenate([np.zeros_like(rows[:1]), rows])
                    for name, rows in episode.labels.items()
                },
            },
        )


class MinariSource(Source):
    """A Minari dataset of the suite's environments, or of Gymnasium-Robotics' kitchen, of `steps` control steps."""

    def __init__(self, dataset: Any) -> None:
        """Takes a dataset that Minari has loaded; raises a ValueError if it is of another environment."""
        self._dataset = dataset
        with files.reading(self._dataset.storage.data_path, "the metadata of a dataset"):
            spec = dataset.storage.metadata.get(SPEC_KEY)
            self.spec = None if spec is None else EpisodeSpec.from_json(spec)
            self._env_spec, self.indices = dataset.env_spec, range(dataset.total_episodes)
            self.steps = dataset.storage.total_steps
        found = self._env_spec and self._env_spec.id
        if found not in (_ORIGINAL_ID, *gymnasium_env.IDS.values(), *gymnasium_env.TASK_IDS.values()):
            raise ValueError(f"dataset {dataset.id} is not of a domain of the suite, but of {found}")

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
        with files.reading(self._dataset.storage.data_path, f"episode {index}"):
            _check_episode_size(self._dataset.storage.data_path, index)
            (data,) = self._dataset.iterate_episodes([index])
            (metadata,) = self._dataset.storage.get_episode_metadata([index])
            infos = {name: np.asarray(array) for name, array in flatten(data.infos or {}, "info").items()}
            rows = (len(data.rewards) + 1,)
            arrays = {
                **flatten(data.observations, "observation"),
                # Other programs also keep strings, or lack the reset's infos.
                **{name: each for name, each in infos.items() if each.dtype.kind in "biuf" and each.shape[:1] == rows},
                "action": data.actions,
                "reward": data.rewards,
                "termination": data.terminations,
                "truncation": data.truncations,
            }
            for label in filter(None, str(metadata.get(_LABELS_KEY, "")).split(",")):
                arrays[label] = arrays.pop(label.replace("label", "info", 1))[1:]
            seed, sentence = metadata.get("seed"), str(metadata.get(INSTRUCTION_KEY, ""))
            seed = None if seed is None else int(seed)
            episode = EpisodeArrays(index=index, seed=seed, arrays=arrays, instruction=sentence)
            episode.check(metadata.get(_ACTIONS_KEY))
        return episode


def find(name: str, root: Path | None) -> MinariSource | None:
    """Returns the dataset of a name or in a folder, None if there is none; see `formats.Format.source`."""
    for data in (Path(name), Path(name, "data")):
        if (data / "metadata.json").is_file():
            return MinariSource(_load_dataset(import_minari().MinariDataset, data))
    if Path(name).exists() or not re.search(r"-v\d+$", name):
        return None
    minari = import_minari()
    check_id(name)
    with minari_root(root):
        if not (absolute_root() / name / "data").exists():
            return None
        return MinariSource(_load_dataset(minari.load_dataset, name))


def _load_dataset(load: Callable[[Any], Any], name: str | Path) -> Any:
    with files.reading(Path(name), "a Minari dataset"):
        return load(name)


def _compress(path: Path) -> None:
    """Compresses the pictures in an HDF5 file, each by itself and without loss; readers need not know."""
    h5py, compressed = importlib.import_module("h5py"), path.with_suffix(".compressed")
    files.reserve(compressed, path.stat().st_size)
    with h5py.File(path, "r") as source, h5py.File(compressed, "w") as target:

        def copy(name: str, item: Any) -> None:
            if isinstance(item, h5py.Group):
                made = target.create_group(name)
            elif item.ndim <= PICTURE_AXES:
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
    """Returns the module; raises an ImportError with the remedy."""
    try:
        importlib.import_module("h5py")
        return importlib.import_module("minari")
    except ImportError as error:
        raise ImportError(f"a dataset needs Minari ({error}): {checks.install_command('record')}") from error


def check_id(dataset_id: str) -> None:
    """Raises a ValueError for a name of a dataset that Minari does not accept."""
    if not _is_id(dataset_id):
        versioned = f"{dataset_id}-v0"
        meant = f"it lacks a version, as in {versioned}" if _is_id(versioned) else "such as me/kettle-v0"
        raise ValueError(f"{checks.shown(dataset_id)} is no name of a dataset in Minari: {meant}")


def _is_id(dataset_id: str) -> bool:
    try:
        importlib.import_module("minari.dataset.minari_dataset").parse_dataset_id(dataset_id)
    except (TypeError, ValueError):  # A missing version is a TypeError.
        return False
    return True


def _check_episode_size(data_path: Path, index: int) -> None:
    """Raises an OSError if an episode in HDF5 declares more than `files.MAX_ARRAY_BYTES`, before it is read."""
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

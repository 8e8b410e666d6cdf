"""Recordings as Minari datasets, each written atomically. Needs the extra `record`."""

import contextlib
import itertools
import os
import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from kitchen_suite import checks, files, installation
from kitchen_suite.datasets import hdf5
from kitchen_suite.episodes.episode import Episode, unflatten
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.tasks.policy_inputs import PICTURE_AXES

# Keys of the metadata of a dataset: the specification of the recording, and the number of episodes asked for.
SPEC_KEY = "kitchen_suite_recording"
_COUNT_KEY = "kitchen_suite_num_episodes"

# Keys of the metadata of an episode: the task's sentence, the digest of the actions, and the names of their labels,
# with commas between them.
_INSTRUCTION_KEY = "instruction"
_ACTIONS_KEY = "actions_sha256"
_LABELS_KEY = "kitchen_suite_labels"

_CHUNK = 20  # Number of episodes in memory at the same time.

_DATA_FILE = "main_data.hdf5"  # Minari's file of all episodes.

_ROOT_VARIABLE = "MINARI_DATASETS_PATH"


def write(path: Path, spec: EpisodeSpec, episodes: Iterable[Episode]) -> None:
    """Writes a dataset to a path in Minari's folder of datasets; the rest of the path is its name, such as `me/set-v0`.

    Labels of actions are infos of the steps that they make, 0 at the reset, as in gym-hil.

    Raises a ValueError for a path that Minari would not find, and an ImportError without Minari.
    """
    minari = import_minari()
    root = _datasets_root()
    if not path.absolute().is_relative_to(root):
        raise ValueError(f"{path} is not in Minari's folder of datasets, {root}")
    dataset_id = path.absolute().relative_to(root).as_posix()
    check_id(dataset_id)
    with contextlib.closing(spec.make_environment()) as environment, _written_elsewhere(minari, path, dataset_id):
        has_pictures = suite_env(environment).observations.has_pictures
        # Minari's JPEG would change pictures.
        options = {"jpeg_encoding": False} if has_pictures else {}
        dataset = _create(minari, dataset_id, spec, environment, **options)
        storage = dataset.storage
        remaining = iter(episodes)
        written, last = 0, 0
        while chunk := list(itertools.islice(remaining, _CHUNK)):
            size = sum(rows.nbytes for episode in chunk for rows in episode.arrays.values())
            hdf5.check_space(storage.data_path / _DATA_FILE, size)
            dataset.update_dataset_from_buffer([_buffer(minari, episode) for episode in chunk])
            storage.update_episode_metadata(list(map(_metadata, chunk)), range(written, written + len(chunk)))
            written += len(chunk)
            last = chunk[-1].index
        if has_pictures:
            hdf5.compress(storage.data_path / _DATA_FILE, PICTURE_AXES)
            storage.update_metadata({"dataset_size": storage.get_size()})
        # As many episodes as were recorded, unless the physics of the last ones diverged.
        storage.update_metadata({SPEC_KEY: spec.as_json(), _COUNT_KEY: last + 1})


@contextlib.contextmanager
def _written_elsewhere(minari: Any, path: Path, dataset_id: str) -> Iterator[None]:
    """Lets Minari write to a hidden folder, of which the dataset gets its path if nothing fails."""
    root = _datasets_root()
    with files.temporary_folder(root / "kitchen-convert") as elsewhere:
        elsewhere.mkdir()
        with folder(elsewhere):
            yield
        namespace = dataset_id.rpartition("/")[0]
        if namespace and namespace not in minari.namespace.list_local_namespaces():
            minari.namespace.create_namespace(namespace)
        os.rename(elsewhere / dataset_id, path)


def _create(minari: Any, dataset_id: str, spec: EpisodeSpec, environment: gymnasium.Env, **options: Any) -> Any:
    """Returns a new dataset without episodes."""
    hdf5.check_space(_datasets_root() / _DATA_FILE, 0)
    with warnings.catch_warnings():
        # About optional metadata: author, permalink, and another environment for evaluation.
        warnings.filterwarnings("ignore", r"`\w+` is set to None")
        return minari.create_dataset_from_buffers(
            dataset_id,
            [],
            env=environment,
            algorithm_name=spec.policy,
            description=f"Policy {spec.policy} in task {spec.task_name} of domain {spec.domain_name}; "
            "reset with an episode's seed, the recovered environment plays it again.",
            # Another version computes other last bits.
            requirements=[f"mujoco=={spec.versions['mujoco']}"],
            **options,
        )


def _buffer(minari: Any, episode: Episode) -> Any:
    """Returns an episode as Minari's collector does."""
    arrays = episode.arrays
    infos = {name.removeprefix("info/"): array for name, array in arrays.items() if name.startswith("info/")}
    for name, rows in episode.labels.items():
        infos[name.removeprefix("label/")] = np.concatenate([np.zeros_like(rows[:1]), rows])
    return minari.data_collector.EpisodeBuffer(
        seed=episode.seed,
        observations=unflatten(arrays, "observation"),
        actions=arrays["action"],
        rewards=arrays["reward"],
        terminations=arrays["termination"],
        truncations=arrays["truncation"],
        infos=infos,
    )


def _metadata(episode: Episode) -> dict[str, str]:
    """Returns what is kept of an episode beside its arrays and what Minari keeps, where there is something."""
    texts = {
        _INSTRUCTION_KEY: episode.instruction,
        _ACTIONS_KEY: episode.actions_sha256,
        _LABELS_KEY: ",".join(episode.labels),
    }
    return {key: text for key, text in texts.items() if text}


def load(name: str) -> Any:
    """Opens the dataset of a name in Minari's folder of datasets, or in a folder of its own; None if there is none.

    Raises an OSError if it cannot be read, and a ValueError for a malformed name.
    """
    minari = import_minari()
    for data in (Path(name), Path(name, "data")):
        if (data / "metadata.json").is_file():
            _check_data(data)
            with files.reading(data, "a Minari dataset"):
                return minari.MinariDataset(data)
    if Path(name).exists() or not re.search(r"-v\d+$", name):
        return None
    check_id(name)
    if not (_datasets_root() / name / "data").exists():
        return None
    _check_data(_datasets_root() / name / "data")
    with files.reading(Path(name), "a Minari dataset"):
        return minari.load_dataset(name)


def _check_data(data: Path) -> None:
    """Raises an OSError unless Minari can read the folder of a dataset safely: JSON of bounded size, and HDF5."""
    record = files.load_json(data / "metadata.json", "the metadata of a Minari dataset")
    if not isinstance(record, dict) or record.get("data_format", "hdf5") != "hdf5":
        raise OSError(f"{data} does not hold a Minari dataset in HDF5, the format that is read")


def data_digest(dataset: Any) -> str:
    """Returns the SHA-256 of the file of all episodes of a dataset."""
    return files.file_digest(dataset.storage.data_path / _DATA_FILE)


def load_episode(dataset: Any, index: int) -> Any:
    """Returns an episode of a dataset as Minari has it; an OSError if it cannot be read, or is too large."""
    data_path = dataset.storage.data_path
    hdf5.check_group(data_path / _DATA_FILE, f"episode_{index}")
    with files.reading(data_path, f"episode {index}"):
        (episode,) = dataset.iterate_episodes([index])
        return episode


@contextlib.contextmanager
def folder(path: Path | None) -> Iterator[Path]:
    """Sets the folder in which Minari finds and writes datasets, and yields it; with None it stays Minari's own."""
    before = os.environ.get(_ROOT_VARIABLE)
    if path is not None:
        os.environ[_ROOT_VARIABLE] = os.path.abspath(path)
    try:
        # Minari would make the folder, and leave it after an error.
        with contextlib.nullcontext() if path is None else files.made_folder(path.absolute()):
            yield _datasets_root()
    finally:
        os.environ.pop(_ROOT_VARIABLE, None)
        os.environ.update({} if before is None else {_ROOT_VARIABLE: before})


def import_minari() -> Any:
    """Returns the module; raises an ImportError with the remedy."""
    try:
        hdf5.library()
        import minari
    except ImportError as error:
        raise ImportError(f"a dataset needs Minari ({error}): {installation.install_command('record')}") from error
    return minari


def check_id(dataset_id: str) -> None:
    """Raises a ValueError for a name of a dataset that Minari does not accept."""
    if not _is_id(dataset_id):
        versioned = f"{dataset_id}-v0"
        meant = f"it lacks a version, as in {versioned}" if _is_id(versioned) else "such as me/kettle-v0"
        raise ValueError(f"{checks.shown(dataset_id)} is no name of a dataset in Minari: {meant}")


def _is_id(dataset_id: str) -> bool:
    from minari.dataset.minari_dataset import parse_dataset_id

    try:
        parse_dataset_id(dataset_id)
    except (TypeError, ValueError):  # A missing version is a TypeError.
        return False
    return True


def _datasets_root() -> Path:
    """Returns the folder of all local datasets."""
    from minari.storage.datasets_root_dir import get_dataset_path

    # With a relative root, Minari looks for its files in the wrong folder.
    return Path(get_dataset_path()).absolute()

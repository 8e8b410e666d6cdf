"""Recordings as LeRobot datasets of version 3, each written atomically; only writing one imports LeRobot."""

import contextlib
import dataclasses
import hashlib
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import files, installation
from kitchen_suite.episodes.episode import PHYSICS_STATE, Episode
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.lerobot.observations import LeRobotObservations, dataset_features, frames_per_second
from kitchen_suite.tasks.policy_inputs import PICTURE_AXES

# File of a dataset with what LeRobot's own lack: the specification of the recording, and the episodes.
RECORDING_FILE = Path("meta", "kitchen_suite.json")

# There are no videos; where none is named, LeRobot loads another one, and prints the errors if that fails.
_VIDEO_BACKEND = "pyav"


def digest(episode: Episode) -> str:
    """Returns a SHA-256 of names, types, shapes and contents of the arrays of an episode that an agent sees in numbers.

    These are all but labels, pictures and the physics state. They have all digits, the observation after the last step,
    and the infos, which datasets do not hold.
    """
    hashed = hashlib.sha256()
    for name, array in sorted(episode.arrays.items()):
        is_picture = name.startswith("observation/") and array.ndim == 1 + PICTURE_AXES
        if not (is_picture or name in episode.labels or name == PHYSICS_STATE):
            hashed.update(f"{name} {array.dtype.str} {array.shape} ".encode())
            hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordedEpisode:
    """An episode of a dataset: its number in the recording, the seed of its reset, and its `digest`."""

    index: int
    seed: int
    sha256: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Record:
    """Contents of `RECORDING_FILE`: `num_episodes` is the number asked for, `episodes` are in the dataset's order.

    Of the `control_frequency` [Hz] the dataset has the whole part as `fps`.
    """

    recording: Mapping[str, Any]
    num_episodes: int
    control_frequency: float
    episodes: list[RecordedEpisode]


def write(path: Path, spec: EpisodeSpec, episodes: Iterable[Episode]) -> None:
    """Writes a dataset, whose id is made of the last two parts of the path, `NAMESPACE/NAME`.

    Raises a ValueError for an observation type that LeRobot does not have, and an ImportError without LeRobot.
    """
    library, dataset_id = import_lerobot(), "/".join(path.parts[-2:])
    with contextlib.closing(spec.make_environment()) as environment, files.atomic_folder(path) as elsewhere, _quietly():
        inner = suite_env(environment)
        observations, fps = LeRobotObservations(inner), frames_per_second(inner)
        features = dataset_features(observations.features)
        options = {"use_videos": False, "video_backend": _VIDEO_BACKEND}
        options["robot_type"] = inner.composer_task.robot.mjcf_model.model
        dataset = library.LeRobotDataset.create(dataset_id, fps, features, root=elsewhere, **options)
        recorded = []
        for episode in episodes:
            _add(dataset, episode, observations.columns(episode), spec)
            assert episode.seed is not None
            recorded.append(RecordedEpisode(index=episode.index, seed=episode.seed, sha256=digest(episode)))
        dataset.finalize()
        record = _Record(
            recording=spec.as_json(),
            # As many as were recorded, unless the physics of the last ones diverged.
            num_episodes=recorded[-1].index + 1,
            control_frequency=float(inner.metadata["render_fps"]),
            episodes=recorded,
        )
        files.write_json(elsewhere / RECORDING_FILE, dataclasses.asdict(record))


def _add(dataset: Any, episode: Episode, columns: Mapping[str, NDArray], spec: EpisodeSpec) -> None:
    # LeRobot has single numbers as arrays of shape (1,).
    rows = {name: each[:, np.newaxis] if each.ndim == 1 else each for name, each in columns.items()}
    task = episode.instruction or spec.task_name.replace("_", " ")
    for step in range(episode.steps):
        dataset.add_frame({**{name: each[step] for name, each in rows.items()}, "task": task})
    dataset.save_episode()


def folder(path: Path | None) -> AbstractContextManager[Path]:
    """Returns a context with the folder of all datasets: the given one, or LeRobot's own for None."""
    return contextlib.nullcontext(home(path))


def home(root: Path | None = None) -> Path:
    """Returns the folder of all local datasets: `root`, or LeRobot's own when omitted."""
    if root is not None:
        return root.absolute()
    caches = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache"), "huggingface")
    hugging_face = Path(os.environ.get("HF_HOME", caches))
    return Path(os.environ.get("HF_LEROBOT_HOME", hugging_face / "lerobot")).expanduser().absolute()


def import_lerobot() -> Any:
    """Returns the module with LeRobot's datasets; raises an ImportError with the remedy."""
    try:
        from lerobot.datasets import lerobot_dataset
    except ImportError as error:
        raise ImportError(f"the dataset needs LeRobot ({error}): {installation.install_command('lerobot')}") from error
    return lerobot_dataset


@contextlib.contextmanager
def _quietly() -> Iterator[None]:
    """Silences Hugging Face's datasets: progress bars for each episode, and log messages about what also raises."""
    import datasets  # Hugging Face's, which LeRobot brings.

    logger = logging.getLogger("datasets")
    had_bars, level = datasets.is_progress_bar_enabled(), logger.level
    datasets.disable_progress_bars()
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)
        if had_bars:
            datasets.enable_progress_bars()

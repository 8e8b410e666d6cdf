"""Recordings as LeRobot datasets of version 3, each written atomically. Needs the extra `lerobot`."""

import contextlib
import dataclasses
import importlib
import json
import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from kitchen_suite import checks, files
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings.formats import DatasetPlan, Source
from kitchen_suite.recordings.lerobot_columns import LeRobotObservations, dataset_features, digest, frames_per_second
from kitchen_suite.rollouts.episode import EpisodeArrays
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.rollouts.spec import EpisodeSpec

# File of a dataset with what LeRobot's own files do not hold: the specification of the recording, and the episodes.
RECORDING_FILE = Path("meta", "kitchen_suite.json")
# File that every LeRobot dataset has.
INFO_FILE = Path("meta", "info.json")

# There are no videos; where none is named, LeRobot loads another one, and prints the errors if that fails.
_VIDEO_BACKEND = "pyav"

# As the hub accepts names.
_DATASET_ID = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*", re.ASCII)
# Columns that LeRobot adds.
_OWN_COLUMNS = ("timestamp", "frame_index", "episode_index", "index", "task_index")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordedEpisode:
    """An episode of a dataset.

    Attributes:
      index: its number in the recording.
      seed: of the environment's reset.
      sha256: see `lerobot_columns.digest`.
    """

    index: int
    seed: int
    sha256: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Record:
    """Contents of `RECORDING_FILE`.

    Attributes:
      recording: specification of the recording.
      num_episodes: number of episodes asked for.
      control_frequency: control steps per second, of which the dataset has the whole part as `fps` [Hz].
      episodes: in the order of the dataset.
    """

    recording: Mapping[str, Any]
    num_episodes: int
    control_frequency: float
    episodes: list[RecordedEpisode]


class LeRobotPlan(DatasetPlan):
    """A LeRobot dataset; its name is `NAMESPACE/NAME`."""

    def __init__(self, dataset_id: str, spec: EpisodeSpec, count: int, root: Path | None = None) -> None:
        super().__init__(dataset_id, spec, count, root)
        self._library = import_lerobot()
        if not _DATASET_ID.fullmatch(dataset_id):
            raise ValueError(f"{checks.shown(dataset_id)} is no name of a LeRobot dataset, such as me/kettle")
        if not self.is_missing:
            record = load_record(self.path)
            self._check_same(record.recording, record.num_episodes)

    @property
    def path(self) -> Path:
        return home(self._root) / self.dataset_id

    def make(self, environment: gymnasium.Env, folder: RecordingFolder, indices: Sequence[int]) -> None:
        inner = suite_env(environment)
        observations, fps = LeRobotObservations(inner), frames_per_second(inner)
        with files.atomic_folder(self.path) as elsewhere, _quietly():
            dataset = self._library.LeRobotDataset.create(
                self.dataset_id,
                fps,
                dataset_features(observations.features),
                root=elsewhere,
                robot_type="franka",
                use_videos=False,
                video_backend=_VIDEO_BACKEND,
            )
            episodes = []
            for index in indices:
                episode = folder.load(index)
                self._add(dataset, episode, observations)
                assert episode.seed is not None
                episodes.append(RecordedEpisode(index=index, seed=episode.seed, sha256=digest(episode)))
            dataset.finalize()
            record = _Record(
                recording=self.spec.as_json(),
                num_episodes=self.count,
                control_frequency=float(inner.metadata["render_fps"]),
                episodes=episodes,
            )
            text = json.dumps(dataclasses.asdict(record), indent=2)
            (elsewhere / RECORDING_FILE).write_text(f"{text}\n", encoding="utf-8")

    def _add(self, dataset: Any, episode: EpisodeArrays, observations: LeRobotObservations) -> None:
        """Adds an episode to a dataset."""
        # LeRobot has single numbers as arrays of shape (1,).
        columns = {
            name: rows[:, np.newaxis] if rows.ndim == 1 else rows
            for name, rows in observations.columns(episode).items()
        }
        task = episode.instruction or self.spec.task_name.replace("_", " ")
        for step in range(episode.steps):
            dataset.add_frame({**{name: rows[step] for name, rows in columns.items()}, "task": task})
        dataset.save_episode()


class LeRobotSource(Source):
    """A dataset that `LeRobotPlan` has made."""

    def __init__(self, folder: Path) -> None:
        """Opens a dataset.

        Raises:
          ImportError: LeRobot is not installed.
          OSError: the dataset cannot be read.
          ValueError: another program has made it, so that the seeds of its episodes are not known.
        """
        if not (folder / RECORDING_FILE).is_file():
            raise ValueError(f"{folder} is no dataset of kitchen-record, which writes the seeds to {RECORDING_FILE}")
        self._record, self._folder = load_record(folder), folder
        with self._reading("the specification of a recording"):
            self._spec = EpisodeSpec.from_json(self._record.recording)
        library = import_lerobot()
        with self._reading("a LeRobot dataset"), _quietly():
            self._dataset = library.LeRobotDataset(folder.name, root=folder, video_backend=_VIDEO_BACKEND)
            self._rows = self._dataset.hf_dataset.with_format("numpy")
        if self._dataset.num_episodes != len(self._record.episodes):
            raise ValueError(f"{folder} has other episodes than its {RECORDING_FILE}: it was changed after recording")

    @property
    def spec(self) -> EpisodeSpec:
        return self._spec

    def make_environment(self, **rendering: Any) -> gymnasium.Env:
        environment = self._spec.make_environment(**rendering)
        self._observations = LeRobotObservations(suite_env(environment))
        return environment

    @property
    def indices(self) -> Sequence[int]:
        return range(len(self._record.episodes))

    def load(self, index: int) -> EpisodeArrays:
        """Reads an episode, with the arrays of `LeRobotObservations.arrays`."""
        recorded = self._record.episodes[index]
        with self._reading(f"episode {index}"):
            bounds = self._dataset.meta.episodes[index]
            rows = self._rows[bounds["dataset_from_index"] : bounds["dataset_to_index"]]
            columns = {name: np.asarray(array) for name, array in rows.items() if name not in _OWN_COLUMNS}
            return EpisodeArrays(
                index=index,
                seed=recorded.seed,
                arrays=self._observations.arrays(columns, recorded.sha256),
                instruction=str(bounds["tasks"][0]),
            )

    def projected(self, replayed: EpisodeArrays) -> EpisodeArrays:
        return self._observations.projected(replayed)

    def _reading(self, what: str) -> contextlib.AbstractContextManager[None]:
        return files.reading(self._folder, what)


def find(name: str, root: Path | None) -> LeRobotSource | None:
    """Returns the dataset of a name or in a folder, None if there is none; see `formats.Format.source`."""
    for folder in (Path(name), home(root) / name):
        if (folder / INFO_FILE).is_file():
            return LeRobotSource(folder)
    return None


def load_record(folder: Path) -> _Record:
    """Returns what `RECORDING_FILE` of a dataset holds; raises an OSError if it cannot be read."""
    path = folder / RECORDING_FILE
    record = files.load_json(path, "the recording of a LeRobot dataset")
    try:
        return files.parse(record, _Record, f"{path} does not describe a recording")
    except ValueError as error:
        raise OSError(str(error)) from error


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
        return importlib.import_module("lerobot.datasets.lerobot_dataset")
    except ImportError as error:
        raise ImportError(
            f"the dataset needs LeRobot, which needs Python 3.12 ({error}): {checks.install_command('lerobot')}"
        ) from error


@contextlib.contextmanager
def _quietly() -> Iterator[None]:
    """Silences Hugging Face's datasets: progress bars for each episode, and log messages about what also raises."""
    datasets, logger = importlib.import_module("datasets"), logging.getLogger("datasets")
    had_bars, level = datasets.is_progress_bar_enabled(), logger.level
    datasets.disable_progress_bars()
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)
        if had_bars:
            datasets.enable_progress_bars()

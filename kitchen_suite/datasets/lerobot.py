"""Recordings as LeRobot datasets of version 3, each written atomically: their columns and names, and their files.

LeRobot's environments observe `agent_pos`, `environment_state` and `pixels` by camera. Its datasets and policies call
these `observation.state`, `observation.environment_state` and `observation.images.<camera>`. Only the datasets need the
extra `lerobot`, which is imported when it is used.
"""

import contextlib
import dataclasses
import hashlib
import importlib
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite import files, installation
from kitchen_suite.episodes.episode import PHYSICS_STATE, Episode, unflatten
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.gymnasium_env.observations import picture_key
from kitchen_suite.tasks.policy_inputs import PICTURE_AXES

# Observation types of the suite that LeRobot has as well.
OBS_TYPES = ("environment_state_agent_pos", "pixels_agent_pos", "pixels_environment_state_agent_pos")

# File of a dataset with what LeRobot's own lack: the specification of the recording, and the episodes.
RECORDING_FILE = Path("meta", "kitchen_suite.json")

# There are no videos; where none is named, LeRobot loads another one, and prints the errors if that fails.
_VIDEO_BACKEND = "pyav"

AGENT_POS, ENVIRONMENT_STATE, PIXELS = "agent_pos", "environment_state", "pixels"

_PREFIX = "observation."
_COLUMNS = {AGENT_POS: f"{_PREFIX}state", ENVIRONMENT_STATE: f"{_PREFIX}{ENVIRONMENT_STATE}"}
_IMAGES = f"{_PREFIX}images."
_ACTION, _REWARD = "action", "next.reward"
_DONE, _TRUNCATED, _SUCCESS = "next.done", "next.truncated", "next.success"


@dataclasses.dataclass(frozen=True)
class Feature:
    """A part of the observation, or the action: LeRobot's kind `STATE`, `ENV`, `VISUAL` or `ACTION`.

    `key` is the name in the environment's observation, that of the column for a picture and for the action, `column`
    the name in datasets and for policies. `names` are of the elements, or of the dimensions of a picture, if they have
    some, and `shape` is of one step.
    """

    key: str
    column: str
    kind: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None = None


class LeRobotObservations:
    """Lays observations of an environment out as LeRobot's environments do.

    `environment_state` is followed by the vectors that the suite observes beside it, such as `requested_tasks`, since
    LeRobot's policies read no others. `space` is that of one environment's observations, `features` are the parts of
    the observation and the action.
    """

    def __init__(self, environment: SuiteEnv) -> None:
        """Raises a ValueError for an environment whose observation type is none of `OBS_TYPES`."""
        given = environment.observation_space
        found = {*given.spaces} if isinstance(given, spaces.Dict) else set()
        if AGENT_POS not in found:
            raise ValueError(f"LeRobot needs obs_type={' or '.join(map(repr, OBS_TYPES))}")
        assert isinstance(given, spaces.Dict)
        if refused := sorted(found & {"depth", "segmentation", "goal_pixels"}):
            raise ValueError(f"LeRobot's policies do not read {' and '.join(refused)}: leave it out")
        # Of the parts of `environment_state` in the suite's observation: of that of its name, and of those beside it.
        self._state_size = _shape(given[ENVIRONMENT_STATE])[0] if ENVIRONMENT_STATE in found else 0
        others = [key for key in given.spaces if key not in (AGENT_POS, ENVIRONMENT_STATE, PIXELS)]
        self._extra_sizes = {key: _shape(given[key])[0] for key in others}
        pictures = environment.composer_task.pictures.pictures
        self._cameras = [picture_key(picture.camera) for picture in pictures]
        parts: dict[str, spaces.Space] = {AGENT_POS: given[AGENT_POS]}
        if vectors := [given[key] for key in self._environment_keys(given.spaces)]:
            low, high = (np.concatenate([getattr(box, side) for box in vectors]) for side in ("low", "high"))
            parts[ENVIRONMENT_STATE] = spaces.Box(low, high, dtype=low.dtype.type)
        images: dict[str, spaces.Space] = self._by_camera(given[PIXELS]) if PIXELS in found else {}
        if images:
            parts[PIXELS] = spaces.Dict([*images.items()])
        self.space = spaces.Dict([*parts.items()])
        columns = {f"{_IMAGES}{camera}": _shape(space) for camera, space in images.items()}
        axes = ("height", "width", "channels")
        seen = [Feature(column, column, "VISUAL", shape, axes) for column, shape in columns.items()]
        action = Feature(_ACTION, _ACTION, "ACTION", _shape(environment.action_space))
        self.features = [*self._vectors(environment), *seen, action]

    def __call__(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """Returns an observation of one environment or, with a leading axis, of many, or of many steps."""
        laid_out: dict[str, Any] = {AGENT_POS: observation[AGENT_POS]}
        if vectors := [observation[key] for key in self._environment_keys(observation)]:
            laid_out[ENVIRONMENT_STATE] = np.concatenate(vectors, axis=-1)
        if PIXELS in observation:
            laid_out[PIXELS] = self._by_camera(observation[PIXELS])
        return laid_out

    def columns(self, episode: Episode) -> dict[str, NDArray]:
        """Returns the columns of an episode of `T` control steps in a dataset: `(T, ...)` each.

        Numbers are float32. A row has an observation, its action, and the outcome `next.*`; none has the last one.
        """
        arrays = episode.arrays
        laid_out = self(unflatten(arrays, "observation"))
        states = {_COLUMNS[key]: laid_out[key][:-1].astype(np.float32) for key in _COLUMNS if key in laid_out}
        pictures = {f"{_IMAGES}{camera}": rows[:-1] for camera, rows in laid_out.get(PIXELS, {}).items()}
        return {
            **states,
            **pictures,
            _ACTION: arrays["action"].astype(np.float32),
            _REWARD: arrays["reward"].astype(np.float32),
            _DONE: arrays["termination"] | arrays["truncation"],
            _TRUNCATED: arrays["truncation"],
            _SUCCESS: arrays["info/is_success"][1:].astype(bool),
        }

    def _environment_keys(self, keys: Mapping[str, Any]) -> list[str]:
        return [*([ENVIRONMENT_STATE] if ENVIRONMENT_STATE in keys else []), *self._extra_sizes]

    def _by_camera(self, pictures: Any) -> dict[str, Any]:
        """Returns pictures, or their spaces, by camera, also where there is one camera."""
        if isinstance(pictures, Mapping | spaces.Dict):
            return {camera: pictures[camera] for camera in self._cameras}
        (camera,) = self._cameras
        return {camera: pictures}

    def _vectors(self, environment: SuiteEnv) -> list[Feature]:
        names = environment.observations.element_names
        extras = [f"{key}[{i}]" for key, size in self._extra_sizes.items() for i in range(size)]
        names[ENVIRONMENT_STATE] = [*(names[ENVIRONMENT_STATE] if self._state_size else []), *extras]
        kinds = {AGENT_POS: "STATE", ENVIRONMENT_STATE: "ENV"}
        return [
            Feature(key, _COLUMNS[key], kind, _shape(self.space[key]), tuple(names[key]))
            for key, kind in kinds.items()
            if key in self.space.spaces
        ]


def _shape(space: spaces.Space) -> tuple[int, ...]:
    assert space.shape is not None
    return space.shape


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


def dataset_features(features: list[Feature]) -> dict[str, dict[str, Any]]:
    """Returns the features of a dataset as LeRobot describes them, by column."""
    described: dict[str, dict[str, Any]] = {}
    for feature in features:
        kind, names = "image" if feature.kind == "VISUAL" else "float32", [*feature.names] if feature.names else None
        described[feature.column] = {"dtype": kind, "shape": feature.shape, "names": names}
    outcomes = {_REWARD: "float32", _DONE: "bool", _TRUNCATED: "bool", _SUCCESS: "bool"}
    return {**described, **{name: {"dtype": kind, "shape": (1,), "names": None} for name, kind in outcomes.items()}}


def frames_per_second(environment: SuiteEnv) -> int:
    """Returns the frequency of control steps [Hz] in whole numbers, as LeRobot has it: 12 for the kitchen's 12.5."""
    return int(environment.metadata["render_fps"])


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
        return importlib.import_module("lerobot.datasets.lerobot_dataset")
    except ImportError as error:
        raise ImportError(f"the dataset needs LeRobot ({error}): {installation.install_command('lerobot')}") from error


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

"""LeRobot's names of observations, and the columns of its datasets; needs no LeRobot.

Its environments observe `agent_pos`, `environment_state` and `pixels` by camera. Its datasets and policies call these
`observation.state`, `observation.environment_state` and `observation.images.<camera>`.
"""

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.observations import picture_key
from kitchen_suite.recordings.formats import LEROBOT
from kitchen_suite.rollouts.episode import EpisodeArrays, unflatten
from kitchen_suite.tasks.task import PICTURE_AXES

AGENT_POS, ENVIRONMENT_STATE, PIXELS = "agent_pos", "environment_state", "pixels"

_PREFIX = "observation."
_COLUMNS = {AGENT_POS: f"{_PREFIX}state", ENVIRONMENT_STATE: f"{_PREFIX}{ENVIRONMENT_STATE}"}
_IMAGES = f"{_PREFIX}images."
_ACTION, _REWARD = "action", "next.reward"
_DONE, _TRUNCATED, _SUCCESS = "next.done", "next.truncated", "next.success"

# Name of the array that stands for all numbers of an episode; see `digest`.
DIGEST = "digest"


@dataclasses.dataclass(frozen=True)
class Feature:
    """A part of the observation, or the action.

    Attributes:
      key: name in the environment's observation; that of the column for a picture and for the action.
      column: name in datasets and for policies.
      kind: LeRobot's type of the feature: `STATE`, `ENV`, `VISUAL` or `ACTION`.
      shape: of one step.
      names: of the elements, or of the dimensions of a picture; None if they have none.
    """

    key: str
    column: str
    kind: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None = None


class LeRobotObservations:
    """Lays observations of an environment out as LeRobot's environments do.

    `environment_state` is followed by the vectors that the suite observes beside it, such as `requested_tasks`, since
    LeRobot's policies read no others.

    Attributes:
      space: of the observations of one environment.
      features: the parts of the observation and the action.
    """

    def __init__(self, environment: SuiteEnv) -> None:
        """Takes an environment with an observation type of `formats.LEROBOT`."""
        given = environment.observation_space
        found = {*given.spaces} if isinstance(given, spaces.Dict) else set()
        if AGENT_POS not in found:
            raise ValueError(f"LeRobot needs obs_type={' or '.join(map(repr, LEROBOT.obs_types))}")
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
        self._picture_spaces: dict[str, spaces.Space] = self._by_camera(given[PIXELS]) if PIXELS in found else {}
        if self._picture_spaces:
            parts[PIXELS] = spaces.Dict([*self._picture_spaces.items()])
        self.space = spaces.Dict([*parts.items()])
        self.features = [*self._vectors(environment), *self._pictures(), _action(environment.action_space)]

    def __call__(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """Returns an observation of one environment or, with a leading axis, of many, or of many steps."""
        laid_out: dict[str, Any] = {AGENT_POS: observation[AGENT_POS]}
        if vectors := [observation[key] for key in self._environment_keys(observation)]:
            laid_out[ENVIRONMENT_STATE] = np.concatenate(vectors, axis=-1)
        if PIXELS in observation:
            laid_out[PIXELS] = self._by_camera(observation[PIXELS])
        return laid_out

    def columns(self, episode: EpisodeArrays) -> dict[str, NDArray]:
        """Returns the columns of an episode of `T` control steps in a dataset: `(T, ...)` each.

        Numbers are float32. The observation after the last step is left out: a row has an observation, the action
        there, and `next.*`, the outcome of the action.
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

    def arrays(self, columns: Mapping[str, NDArray], digest: str) -> dict[str, NDArray]:
        """Returns the arrays of an episode that its columns hold, by the names of `EpisodeArrays`.

        Observations lack the last one. `digest` is that of the episode, as an array of bytes.
        """
        states = columns.get(_COLUMNS[ENVIRONMENT_STATE])
        arrays = {f"observation/{AGENT_POS}": columns[_COLUMNS[AGENT_POS]]}
        if self._state_size and states is not None:
            arrays[f"observation/{ENVIRONMENT_STATE}"] = states[:, : self._state_size]
        start = self._state_size
        for key, size in self._extra_sizes.items():
            assert states is not None
            arrays[f"observation/{key}"], start = states[:, start : start + size], start + size
        pictures = {camera: columns[f"{_IMAGES}{camera}"] for camera in self._cameras}
        return {
            **arrays,
            **{f"observation/{PIXELS}/{camera}": rows for camera, rows in pictures.items()},
            "action": columns[_ACTION],
            "reward": columns[_REWARD],
            "termination": columns[_DONE] & ~columns[_TRUNCATED],
            "truncation": columns[_TRUNCATED],
            "info/is_success": columns[_SUCCESS],
            DIGEST: np.frombuffer(bytes.fromhex(digest), np.uint8),
        }

    def projected(self, episode: EpisodeArrays) -> EpisodeArrays:
        """Returns an episode with the arrays that would be read back from a dataset of it."""
        arrays = self.arrays(self.columns(episode), digest(episode))
        return dataclasses.replace(episode, arrays=arrays)

    def _environment_keys(self, keys: Mapping[str, Any]) -> list[str]:
        """Returns the keys of what `environment_state` is made of."""
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

    def _pictures(self) -> list[Feature]:
        columns = {f"{_IMAGES}{camera}": _shape(space) for camera, space in self._picture_spaces.items()}
        names = ("height", "width", "channels")
        return [Feature(column, column, "VISUAL", shape, names) for column, shape in columns.items()]


def _shape(space: spaces.Space) -> tuple[int, ...]:
    assert space.shape is not None
    return space.shape


def _action(space: spaces.Space) -> Feature:
    return Feature(_ACTION, _ACTION, "ACTION", _shape(space))


def digest(episode: EpisodeArrays) -> str:
    """Returns a SHA-256 of names, types, shapes and contents of all arrays of an episode but pictures.

    These arrays have all digits, the observation after the last step, and the infos, which datasets do not hold.
    """
    hashed = hashlib.sha256()
    for name, array in sorted(episode.arrays.items()):
        if not (name.startswith("observation/") and array.ndim == 1 + PICTURE_AXES):
            hashed.update(f"{name} {array.dtype.str} {array.shape} ".encode())
            hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()


def dataset_features(features: list[Feature]) -> dict[str, dict[str, Any]]:
    """Returns the features of a dataset as LeRobot describes them, by column."""
    described = {
        feature.column: {
            "dtype": "image" if feature.kind == "VISUAL" else "float32",
            "shape": feature.shape,
            "names": [*feature.names] if feature.names else None,
        }
        for feature in features
    }
    outcomes = {_REWARD: "float32", _DONE: "bool", _TRUNCATED: "bool", _SUCCESS: "bool"}
    return {**described, **{name: {"dtype": kind, "shape": (1,), "names": None} for name, kind in outcomes.items()}}


def frames_per_second(environment: SuiteEnv) -> int:
    """Returns the frequency of an environment's control steps [Hz], rounded down.

    LeRobot's datasets and videos have a whole number of frames per second: 12 for the kitchen's 12.5.
    """
    return int(environment.metadata["render_fps"])

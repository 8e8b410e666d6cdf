"""Observations of the suite as LeRobot has them; needs no LeRobot.

LeRobot's environments observe `agent_pos`, `environment_state` and `pixels` by camera. Its datasets and policies call
these `observation.state`, `observation.environment_state` and `observation.images.<camera>`.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite.episodes.episode import Episode, unflatten
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.gymnasium_env.observations import picture_key

# Observation types of the suite that LeRobot has as well.
OBS_TYPES = ("environment_state_agent_pos", "pixels_agent_pos", "pixels_environment_state_agent_pos")

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


def environment_keys(keys: Iterable[str]) -> list[str]:
    """Returns which parts of an observation of the suite make LeRobot's `environment_state`, in its order."""
    found = [key for key in keys if key not in (AGENT_POS, PIXELS)]
    return sorted(found, key=lambda key: key != ENVIRONMENT_STATE)


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
        others = [key for key in environment_keys(given.spaces) if key != ENVIRONMENT_STATE]
        self._extra_sizes = {key: _shape(given[key])[0] for key in others}
        pictures = environment.composer_task.pictures.pictures
        self._cameras = [picture_key(picture.camera) for picture in pictures]
        parts: dict[str, spaces.Space] = {AGENT_POS: given[AGENT_POS]}
        if vectors := [given[key] for key in environment_keys(given.spaces)]:
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
        if vectors := [observation[key] for key in environment_keys(observation)]:
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

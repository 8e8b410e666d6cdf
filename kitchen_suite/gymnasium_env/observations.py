"""The observation types of the Gymnasium environments, as parts of an observation: spaces, and how each is read.

An observation of the suite's own environment is a dict by observable. Its arrays of numbers, end to end, are the flat
observation, from which most parts of an observation type are taken.
"""

import functools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.tasks.pictures import GOAL_PIXELS, Picture
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.tasks.terms import Observation

# Kinds of parts, in the order of the observation, by observation type. `goal` needs a task with goals.
OBS_TYPES: Mapping[str, tuple[str, ...]] = {
    "goal": ("observation", "goals"),
    "state": ("observation",),
    "environment_state_agent_pos": ("environment_state", "agent_pos"),
    "pixels": ("pixels",),
    "pixels_agent_pos": ("pixels", "agent_pos"),
    "pixels_environment_state_agent_pos": ("pixels", "environment_state", "agent_pos"),
}

# Arguments of tasks that choose what cameras observe.
PICTURE_OPTIONS = ("cameras", "image_size", "depth", "segmentation")

# Arguments of environments on which nothing but pictures and the layout of observations depends.
OF_PICTURES = frozenset({*PICTURE_OPTIONS, "obs_type", "render_quality"})

# Arguments of environments on which nothing of an episode but its observations depends.
OF_OBSERVATIONS = OF_PICTURES | {"extra_observables", "goal_format"}


class Present(NamedTuple):
    """The present step of one environment, or of many, from which observations are read.

    Attributes:
      flat: `(..., m)`, the flat observation, in a fresh array.
      simulation: the physics.
      state: of the MDP.
      pictures: `(..., height, width, channels)` by observation key; among them there may be other observations.
    """

    flat: NDArray
    simulation: Simulation
    state: Any
    pictures: Mapping[str, NDArray]


class Entry(NamedTuple):
    """A part of an observation.

    Attributes:
      space: of one environment.
      read: returns the part in fresh arrays, with any leading axes.
    """

    space: spaces.Space
    read: Callable[[Present], Any]


def has_pictures(obs_type: str) -> bool:
    """Whether an observation type holds pictures, and so needs cameras and a GL library."""
    return "pixels" in OBS_TYPES[obs_type]


def picture_options(
    options: Mapping[str, Any], obs_type: str, obs_types: Collection[str], default_cameras: Sequence[str]
) -> dict[str, Any]:
    """Returns the arguments of a task with those of the pictures that an observation type needs."""
    named = {name: value for name, value in options.items() if name in PICTURE_OPTIONS}
    given = {name: value for name, value in named.items() if value is not None and value is not False}
    others = {name: value for name, value in options.items() if name not in PICTURE_OPTIONS}
    if has_pictures(obs_type):
        return {**others, **given, "cameras": checks.unique_names(given.get("cameras", default_cameras), "cameras")}
    if given:
        name, value = next(iter(given.items()))
        types = [each for each in obs_types if has_pictures(each)]
        raise ValueError(f"{name}={checks.shown(value)} needs an obs_type with pictures, {types}, not {obs_type!r}")
    return others


def check_extras(task: SuiteTask, obs_type: str, obs_types: Collection[str]) -> None:
    """Raises a ValueError if observations of a type have no part for some extra observables of a task."""
    if lost := _lost_extras(task, obs_type):
        types = [name for name in obs_types if not _lost_extras(task, name)]
        raise ValueError(
            f"observations of obs_type {obs_type!r} have no part for extra_observables {lost}: leave them out, or "
            f"choose an obs_type of {types}"
        )


def observe_by_runner(task: SuiteTask) -> None:
    """Switches off the observables of numbers, which composer would read one by one, and the runner returns as one.

    Raises a ValueError if an observable of an entity is enabled that the task does not observe.
    """
    for part in task.observed.values():
        part.enabled = False
    for entity in task.root_entity.iter_entities():
        for key, part in entity.observables.as_dict(fully_qualified=False).items():
            if part.enabled:
                raise ValueError(
                    f"observable {key!r} of entity {entity.mjcf_model.model!r} is enabled, which Gymnasium's "
                    "environments do not observe: add it to the task's extra_observations"
                )


def _lost_extras(task: SuiteTask, obs_type: str) -> list[str]:
    of_robot = task.quantities.of_robot
    parts = {key: "agent_pos" if key in of_robot else "environment_state" for key in task.quantities.by_name}
    return [key for key, part in parts.items() if {"observation", part}.isdisjoint(OBS_TYPES[obs_type])]


class Observations:
    """Converts between the forms of an environment's observations: the suite's own, flat, and that of its type.

    Attributes:
      flat_space: of the flat observation.
      space: of the observations.
      has_pictures: whether they hold pictures.
      has_goals: whether they hold the achieved and the desired goal.
      hidden: keys of the suite's own observation of which they hold nothing.
    """

    def __init__(self, task: SuiteTask, obs_type: str, *, flat_goals: bool, dtype: Any) -> None:
        """Finds the parts of the flat observation, and those of the observation type.

        Args:
          task: that is observed; its scene is compiled.
          obs_type: a key of `OBS_TYPES`.
          flat_goals: whether goals are one array each, and not dicts by task.
          dtype: type of the flat observation.
        """
        self._task = task
        self._mdp = task.mdp
        self._simulation = task.simulation
        self._flat_goals = flat_goals
        self._dtype = dtype
        self.has_pictures = has_pictures(obs_type)
        self.has_goals = "goals" in OBS_TYPES[obs_type]
        self._slices = task.flat_slices
        sizes = [part.stop - part.start for part in self._slices.values()]
        terms = {**self._mdp.observations, **task.observations.by_name}
        unbounded = (-math.inf, math.inf)
        bounds = [(terms[key].minimum, terms[key].maximum) if key in terms else unbounded for key in self._slices]
        low, high = (np.repeat(side, sizes).astype(dtype) for side in zip(*bounds, strict=True))
        self.flat_space = spaces.Box(low, high, dtype=dtype)
        of_robot = {*task.quantities.of_robot, *(key for key, term in terms.items() if term.of_robot)}
        robot = [np.arange(part.start, part.stop) for key, part in self._slices.items() if key in of_robot]
        self._robot = np.concatenate([*robot, np.zeros(0, np.int64)])
        self._rest = np.setdiff1d(np.arange(low.size), self._robot)
        kinds = {
            "observation": lambda: {"observation": Entry(self.flat_space, lambda present: present.flat)},
            "goals": self._goal_entries,
            "environment_state": lambda: {"environment_state": self._elements(self._rest)},
            "agent_pos": lambda: {"agent_pos": self._elements(self._robot)},
            "pixels": self._picture_entries,
        }
        self._entries = {key: part for kind in OBS_TYPES[obs_type] for key, part in kinds[kind]().items()}
        self._entries |= self._request_entries()
        shown = {"observation", "environment_state"}.intersection(OBS_TYPES[obs_type])
        shown_of_robot = {"observation", "agent_pos"}.intersection(OBS_TYPES[obs_type])
        hidden = [key for key in self._slices if not (shown_of_robot if key in of_robot else shown)]
        if "goals" not in OBS_TYPES[obs_type]:
            hidden += goal_keys(task)
        self.hidden = frozenset(hidden)
        self._is_array = OBS_TYPES[obs_type] == ("observation",)
        boxes = {key: part.space for key, part in self._entries.items()}
        if self._is_array:
            low, high = (np.concatenate([getattr(box, side) for box in boxes.values()]) for side in ("low", "high"))
            self.space: spaces.Space = spaces.Box(low, high, dtype=dtype)
        else:
            self.space = next(iter(boxes.values())) if len(boxes) == 1 else spaces.Dict([*boxes.items()])

    def _goal_entries(self) -> dict[str, Entry]:
        """Returns the goals: arrays, or dicts by task."""
        return {key: self._goal_entry(term) for key, term in self._mdp.goal_observations.items()}

    def _goal_entry(self, term: Observation) -> Entry:
        goals = self._mdp.goals
        if self._flat_goals:
            return Entry(_box(term, goals.desired.shape), lambda present: _read(term, present))
        by_task: dict[str, spaces.Space] = {
            task: _box(term, goal.shape) for task, goal in goals.split(goals.desired).items()
        }
        return Entry(spaces.Dict(by_task), lambda present: goals.split(_read(term, present)))

    def _request_entries(self) -> dict[str, Entry]:
        """Returns what is observed of requests, which every observation type has after its own parts."""
        parts: dict[str, Entry] = {}
        if self.has_pictures and self._mdp.has_goal_pictures:
            part = picture_entry({picture_key(each.camera): each for each in self._task.pictures.colour})
            read = part.read
            parts[GOAL_PIXELS] = part._replace(
                read=lambda present: read(present._replace(pictures=self._goal_pictures(present.state)))
            )
        for key, term in self._mdp.request_observations.items():
            size = np.shape(term.read(self._simulation, self._task.state))
            parts[key] = Entry(_box(term, size), functools.partial(_read, term))
        return parts

    def _goal_pictures(self, state: Any) -> dict[str, NDArray[np.uint8]]:
        """Returns the pictures `(..., height, width, 3)` of goals by camera, in fresh arrays; empty if none."""
        cameras = [picture.camera for picture in self._task.pictures.colour]
        if not cameras or not self._mdp.has_goal_pictures:
            return {}
        rows = np.moveaxis(self._mdp.goal_pictures(state), -4, 0)
        return {camera: row.copy() for camera, row in zip(cameras, rows, strict=True)}

    def _elements(self, indices: NDArray[np.int64]) -> Entry:
        space = self.flat_space
        box = spaces.Box(space.low[indices], space.high[indices], dtype=self._dtype)
        return Entry(box, lambda present: present.flat.take(indices, axis=-1))

    def _picture_entries(self) -> dict[str, Entry]:
        """Returns the pictures by kind: an array of one camera, or a dict by camera."""
        kinds: dict[str, dict[str, Picture]] = {}
        for picture in self._task.pictures.pictures:
            kinds.setdefault(picture.kind, {})[picture_key(picture.camera)] = picture
        return {kind: picture_entry(by_camera) for kind, by_camera in kinds.items()}

    def __call__(self, present: Present) -> Any:
        """Returns an observation."""
        parts = {key: part.read(present) for key, part in self._entries.items()}
        if len(parts) == 1:
            return next(iter(parts.values()))
        if self._is_array:
            return np.concatenate([*parts.values()], axis=-1, dtype=present.flat.dtype, casting="same_kind")
        return parts

    def recover_flat(self, observation: Any) -> NDArray | None:
        """Returns the flat observation `(..., m)` in an observation; None if it is not there as a whole."""
        if self._is_array:
            return observation[..., : self._robot.size + self._rest.size]
        if "observation" in self._entries:
            return observation["observation"]
        if "environment_state" not in self._entries:
            return None
        parts = [observation["environment_state"], observation["agent_pos"]]
        return np.concatenate(parts, axis=-1).take(np.argsort([*self._rest, *self._robot]), axis=-1)

    @property
    def element_names(self) -> dict[str, list[str]]:
        """Names of the elements of `agent_pos` and of `environment_state`, such as `franka/joint_positions[0]`."""
        parts = self._slices.items()
        names = [f"{key}[{i}]" for key, part in parts for i in range(part.stop - part.start)]
        kinds = {"agent_pos": self._robot, "environment_state": self._rest}
        return {kind: [names[i] for i in indices.tolist()] for kind, indices in kinds.items()}

    @property
    def robot_elements(self) -> list[int]:
        """Indices of the elements of `agent_pos` in the flat observation."""
        elements: list[int] = self._robot.tolist()
        return elements

    def split(self, flat: NDArray) -> dict[str, NDArray]:
        """Returns copies of the parts `(..., k)` of a flat observation by their names in the suite's own."""
        return {key: flat[..., part].copy() for key, part in self._slices.items()}

    def suite_numbers(self, present: Present) -> dict[str, NDArray]:
        """Returns an observation of the suite's own environment without pictures, which need not be taken."""
        goals = {
            f"{key}/{task}": part
            for key, term in self._mdp.goal_observations.items()
            for task, part in self._mdp.goals.split(_read(term, present)).items()
        }
        requests = {key: _read(term, present) for key, term in self._mdp.request_observations.items()}
        return {**self.split(present.flat), **goals, **requests}

    def suite_observation(self, present: Present) -> dict[str, NDArray]:
        """Returns an observation of the suite's own environment, pictures last."""
        goal_pictures = self._goal_pictures(present.state).items()
        return {
            **self.suite_numbers(present),
            **{f"{GOAL_PIXELS}/{camera}": picture for camera, picture in goal_pictures},
            **{key: present.pictures[key] for key in self._task.pictures.by_name},
        }


def goal_keys(task: SuiteTask) -> list[str]:
    """Returns the keys of the goals in the suite's own observation of a task; none in a domain without goals."""
    return [f"{key}/{name}" for key in task.mdp.goal_observations for name in task.mdp.goals.tasks]


def _box(term: Observation, shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(term.minimum, term.maximum, shape, np.float64)


def _read(term: Observation, present: Present) -> NDArray[np.float64]:
    """Returns what a term of the MDP reads, in a fresh array."""
    return np.array(term.read(present.simulation, present.state))


def picture_key(camera: str) -> str:
    """Returns the key of a camera in observations: its name, with `_` for the slash, which file formats reserve."""
    return camera.replace("/", "_")


def picture_entry(by_camera: Mapping[str, Picture]) -> Entry:
    """Returns the part with the pictures of one kind: an array of one camera, or a dict by camera."""
    specs = {key: picture.taker.array_spec for key, picture in by_camera.items()}
    boxes = {
        key: spaces.Box(spec.minimum.item(), spec.maximum.item(), spec.shape, spec.dtype.type)
        for key, spec in specs.items()
    }
    if len(by_camera) == 1:
        ((key, picture),) = by_camera.items()
        return Entry(boxes[key], lambda present: present.pictures[picture.key])
    return Entry(
        spaces.Dict([*boxes.items()]),
        lambda present: {key: present.pictures[each.key] for key, each in by_camera.items()},
    )

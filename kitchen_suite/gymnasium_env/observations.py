"""The observations of a Gymnasium environment: what they are made of, and their forms."""

import abc
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.environment import Environment
from kitchen_suite.tasks.observables import Picture, Pictures


@dataclasses.dataclass(frozen=True, kw_only=True)
class Goals:
    """The goals of an environment's tasks.

    Attributes:
      space: of the achieved and of the desired goal.
      lay_out: returns both for a state of the MDP, by key, in fresh arrays.
      by_key: returns both in fresh arrays as the suite's own observation has them.
      further: spaces `(n,)` of vectors that every observation type has after its own parts, by key.
      lay_further_out: returns these vectors `(..., n)` for a state of the MDP, by key, in fresh arrays.
    """

    space: spaces.Space
    lay_out: Callable[[Any], dict[str, Any]]
    by_key: Callable[[Any], dict[str, NDArray]]
    further: Mapping[str, spaces.Box] = dataclasses.field(default_factory=dict)
    lay_further_out: Callable[[Any], dict[str, NDArray]] = lambda state: {}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Parts:
    """The parts of an observation.

    Attributes:
      flat: space of the flat observation `(m,)`: the MDP's, then extra observables.
      robot: `(k,)`, indices of the elements that are the robot's, in the order of `agent_pos`.
      goals: None in a domain without goals.
      pictures: of the cameras.
    """

    flat: spaces.Box
    robot: NDArray[np.int64]
    goals: Goals | None
    pictures: Pictures


class Layout(abc.ABC):
    """An observation type.

    Attributes:
      space: of the observations.
      has_pictures: whether observations hold pictures, and so need cameras.
    """

    has_pictures: bool = False
    space: spaces.Space

    @abc.abstractmethod
    def __init__(self, parts: Parts) -> None:
        """Makes the space."""

    @abc.abstractmethod
    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> Any:
        """Returns an observation.

        Args:
          flat: `(..., m)`, a fresh array.
          state: the MDP's state, from which goals are read.
          pictures: `(..., height, width, channels)` each, by the keys of `Pictures`.
        """

    def flat(self, observation: Any) -> NDArray | None:
        """Returns the flat observation `(..., m)` in an observation; None if it is not there as a whole."""
        del observation
        return None


class State(Layout):
    """`state`: the flat observation."""

    def __init__(self, parts: Parts) -> None:
        self.space = parts.flat

    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> NDArray:
        return flat

    def flat(self, observation: Any) -> NDArray | None:
        return observation


class Goal(Layout):
    """`goal`: a dict of the flat observation, the achieved goal and the desired goal."""

    def __init__(self, parts: Parts) -> None:
        assert parts.goals is not None
        self._goals, goal = parts.goals, parts.goals.space
        self.space = spaces.Dict(observation=parts.flat, achieved_goal=goal, desired_goal=goal)

    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> dict[str, Any]:
        return {"observation": flat, **self._goals.lay_out(state)}

    def flat(self, observation: Any) -> NDArray | None:
        return observation["observation"]


class EnvironmentStateAgentPos(Layout):
    """`environment_state_agent_pos`: a dict of the robot's part of the flat observation and of the rest."""

    def __init__(self, parts: Parts) -> None:
        self._robot = parts.robot
        self._rest = np.setdiff1d(np.arange(parts.flat.shape[0]), parts.robot)
        self.space = spaces.Dict(
            environment_state=_columns(parts.flat, self._rest), agent_pos=_columns(parts.flat, self._robot)
        )

    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> dict[str, NDArray]:
        return {"environment_state": flat.take(self._rest, axis=-1), "agent_pos": flat.take(self._robot, axis=-1)}

    def flat(self, observation: Any) -> NDArray | None:
        parts = [observation["environment_state"], observation["agent_pos"]]
        order = np.argsort(np.concatenate([self._rest, self._robot]))
        return np.concatenate(parts, axis=-1).take(order, axis=-1)


class Pixels(Layout):
    """`pixels`: the pictures; where depth or segmentation are asked for, a dict of `pixels` and these."""

    has_pictures = True

    def __init__(self, parts: Parts) -> None:
        self._kinds = _by_kind(parts.pictures)
        by_kind = {kind: _picture_space(pictures) for kind, pictures in self._kinds.items()}
        self.space = by_kind["pixels"] if len(by_kind) == 1 else spaces.Dict([*by_kind.items()])

    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> Any:
        by_kind = _lay_pictures_out(self._kinds, pictures)
        return by_kind["pixels"] if len(by_kind) == 1 else by_kind


class PixelsAgentPos(Layout):
    """`pixels_agent_pos`: a dict of the pictures and of the robot's part of the flat observation."""

    has_pictures = True

    def __init__(self, parts: Parts) -> None:
        self._kinds, self._robot = _by_kind(parts.pictures), parts.robot
        by_kind = {kind: _picture_space(pictures) for kind, pictures in self._kinds.items()}
        self.space = spaces.Dict([*by_kind.items(), ("agent_pos", _columns(parts.flat, parts.robot))])

    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> dict[str, Any]:
        return {**_lay_pictures_out(self._kinds, pictures), "agent_pos": flat.take(self._robot, axis=-1)}


class Extended(Layout):
    """An observation type with the goals' further vectors: at the end of an array of the state, else as dict keys."""

    def __init__(self, layout: Layout, goals: Goals) -> None:
        """Extends the space of a layout."""
        self._layout, self._goals, self.has_pictures = layout, goals, layout.has_pictures
        if isinstance(layout, State):
            assert isinstance(layout.space, spaces.Box)
            boxes = [layout.space, *goals.further.values()]
            low, high = (np.concatenate([getattr(box, side) for box in boxes]) for side in ("low", "high"))
            self.space = spaces.Box(low, high, dtype=layout.space.dtype.type)
            self._size = layout.space.shape[0]
            return
        inner = layout.space.spaces if isinstance(layout.space, spaces.Dict) else {"pixels": layout.space}
        self.space = spaces.Dict([*inner.items(), *goals.further.items()])

    def __call__(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> Any:
        observation, further = self._layout(flat, state, pictures), self._goals.lay_further_out(state)
        if isinstance(self._layout, State):
            parts = [observation, *further.values()]
            return np.concatenate(parts, axis=-1, dtype=observation.dtype, casting="same_kind")
        return {**(observation if isinstance(observation, Mapping) else {"pixels": observation}), **further}

    def flat(self, observation: Any) -> NDArray | None:
        return self._layout.flat(observation[..., : self._size] if isinstance(self._layout, State) else observation)


# Observation types of all domains by public name, and those that need goals.
LAYOUTS: Mapping[str, type[Layout]] = MappingProxyType(
    {
        "state": State,
        "environment_state_agent_pos": EnvironmentStateAgentPos,
        "pixels": Pixels,
        "pixels_agent_pos": PixelsAgentPos,
    }
)
GOAL_LAYOUTS: Mapping[str, type[Layout]] = MappingProxyType({"goal": Goal, **LAYOUTS})


def picture_key(camera: str) -> str:
    """Returns the key of a camera in observations: its name, with `_` for the slash, which file formats reserve."""
    return camera.replace("/", "_")


def _columns(space: spaces.Box, indices: NDArray[np.int64]) -> spaces.Box:
    """Returns the space of some elements of a flat observation."""
    return spaces.Box(space.low[indices], space.high[indices], dtype=space.dtype.type)


def _by_kind(pictures: Pictures) -> dict[str, list[Picture]]:
    by_kind: dict[str, list[Picture]] = {}
    for picture in pictures.pictures:
        by_kind.setdefault(picture.kind, []).append(picture)
    return by_kind


def _picture_space(pictures: list[Picture]) -> spaces.Space:
    """Returns the space of the pictures of one kind: an array of one camera, or a dict by camera."""
    by_camera = {picture_key(each.camera): _box(each) for each in pictures}
    return next(iter(by_camera.values())) if len(by_camera) == 1 else spaces.Dict([*by_camera.items()])


def _box(picture: Picture) -> spaces.Box:
    spec = picture.taker.array_spec
    return spaces.Box(spec.minimum.item(), spec.maximum.item(), spec.shape, spec.dtype.type)


def _lay_pictures_out(kinds: Mapping[str, list[Picture]], pictures: Mapping[str, NDArray]) -> dict[str, Any]:
    """Returns pictures by kind: an array of one camera, or a dict by camera."""
    laid_out: dict[str, Any] = {}
    for kind, each in kinds.items():
        by_camera = {picture_key(picture.camera): pictures[picture.key] for picture in each}
        laid_out[kind] = by_camera if len(by_camera) > 1 else next(iter(by_camera.values()))
    return laid_out


@dataclasses.dataclass(frozen=True, kw_only=True)
class ObservationConfig:
    """Observation types and cameras of a domain.

    Attributes:
      obs_types: observation types by name; the first is the default.
      default_cameras: cameras of the observation types with pictures where none are named.
      robot_keys: parts of the flat observation that are the robot's, by their names in the suite's own observation.
      limit: bound of the flat observation.
      dtype: type of the flat observation.
    """

    obs_types: Mapping[str, type[Layout]] = dataclasses.field(default_factory=lambda: LAYOUTS)
    default_cameras: Sequence[str] = ("overview",)
    robot_keys: Sequence[str] = ("joint_positions", "joint_velocities")
    limit: float = math.inf
    dtype: type[np.floating] = np.float32

    @property
    def default_type(self) -> str:
        """Name of the observation type where none is named."""
        return next(iter(self.obs_types))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ObservationSettings:
    """Arguments of the Gymnasium environments that choose what is observed.

    Attributes:
      obs_type: observation type, such as `state` or `pixels_agent_pos`; the domain's default when None.
      cameras: names of the cameras whose pictures are observed, with a type that has pictures; the domain's default
        when None.
      image_size: height and width of the pictures [pixels]; 128 x 128 when None.
      depth: whether each camera also measures depth [m].
      segmentation: whether each camera also returns the object that each pixel shows.
      extra_observables: further quantities of the flat observation, such as `franka/end_effector_pose`; see
        `tasks.extra_observables`.
    """

    obs_type: str | None = None
    cameras: Sequence[str] | None = None
    image_size: Sequence[int] | None = None
    depth: bool = False
    segmentation: bool = False
    extra_observables: Sequence[str] = ()

    def layout(self, config: ObservationConfig) -> type[Layout]:
        """Returns the class of the observation type.

        Raises:
          TypeError: `obs_type` is no string.
          ValueError: the domain has no such type.
        """
        name = config.default_type if self.obs_type is None else self.obs_type
        return config.obs_types[checks.choice(name, config.obs_types.keys(), "obs_type")]

    def task_options(self, config: ObservationConfig) -> dict[str, Any]:
        """Returns the arguments of the task that add what is to be observed.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: there are no cameras, or a setting of pictures beside an observation type without pictures.
        """
        names = ("cameras", "image_size", "depth", "segmentation")
        pictures = {name: getattr(self, name) for name in names if getattr(self, name) not in (None, False)}
        # Domains of one's own may have tasks that add nothing.
        extras = {} if self.extra_observables == () else {"extra_observables": self.extra_observables}
        if self.layout(config).has_pictures:
            cameras = checks.unique_names(pictures.get("cameras", config.default_cameras), "cameras")
            return {**extras, **pictures, "cameras": cameras}
        if pictures:
            name, value = next(iter(pictures.items()))
            types = [each for each, layout in config.obs_types.items() if layout.has_pictures]
            found = config.default_type if self.obs_type is None else self.obs_type
            raise ValueError(f"{name}={value!r} needs an obs_type with pictures, {types}, not {found!r}")
        return extras


class Observations:
    """Converts between the forms of an environment's observations: the suite's own, flat, and that of their type.

    Attributes:
      layout: the observation type.
      space: of the flat observation.
    """

    def __init__(
        self,
        environment: Environment,
        config: ObservationConfig,
        layout: type[Layout],
        goals: Goals | None,
    ) -> None:
        """Finds the parts of the flat observation.

        Args:
          environment: the suite's environment, with all observables enabled that it is to have.
          config: of the domain.
          layout: class of the observation type.
          goals: of the environment's tasks; None in a domain without goals.
        """
        task, self._dtype, self._goals = environment.task, config.dtype, goals
        extras, self._pictures = task.extras, task.pictures
        spec, observables = environment.observation_spec(), task.observables
        # The spec may have observables that have been disabled since.
        keys = [key for key in spec if observables[key].enabled and key not in self._pictures.by_name]
        sizes = [spec[key].shape[0] for key in keys]
        stops = np.cumsum(sizes).tolist()
        self._slices = {key: slice(stop - size, stop) for key, size, stop in zip(keys, sizes, stops, strict=True)}
        of_robot = {*config.robot_keys, *(extras.of_robot if extras else ())}
        robot = [np.arange(part.start, part.stop) for key, part in self._slices.items() if key in of_robot]
        limits = [math.inf if key in task.extra_observables else config.limit for key in keys]
        bound = np.repeat(limits, sizes).astype(config.dtype)
        self.space = spaces.Box(-bound, bound, dtype=config.dtype)
        self._robot = np.concatenate([*robot, np.zeros(0, np.int64)])
        parts = Parts(flat=self.space, robot=self._robot, goals=goals, pictures=self._pictures)
        self.layout: Layout = layout(parts)
        if goals and goals.further:
            self.layout = Extended(self.layout, goals)

    @property
    def element_names(self) -> dict[str, list[str]]:
        """Names of the elements of `agent_pos` and of `environment_state`, such as `franka/joint_positions[0]`."""
        parts = self._slices.items()
        names = [f"{key}[{i}]" for key, part in parts for i in range(part.stop - part.start)]
        robot = self._robot.tolist()
        rest = [name for i, name in enumerate(names) if i not in robot]
        return {"agent_pos": [names[i] for i in robot], "environment_state": rest}

    def flat(self, observation: Mapping[str, NDArray]) -> NDArray:
        """Returns the flat observation `(m,)` in one of the suite's own, in a fresh array."""
        parts = [observation[key] for key in self._slices]
        return np.concatenate(parts, dtype=self._dtype, casting="same_kind")

    def split(self, flat: NDArray) -> dict[str, NDArray]:
        """Returns copies of the parts `(..., k)` of a flat observation by their names in the suite's own."""
        return {key: flat[..., part].copy() for key, part in self._slices.items()}

    def suite_layout(self, flat: NDArray, state: Any, pictures: Mapping[str, NDArray]) -> dict[str, NDArray]:
        """Lays an observation out as the suite's own: state, goals, pictures; arguments as of `Layout.__call__`."""
        goals = self._goals.by_key(state) if self._goals else {}
        return {**self.split(flat), **goals, **{key: pictures[key] for key in self._pictures.by_name}}

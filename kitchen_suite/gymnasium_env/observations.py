"""The observations of a Gymnasium environment: what they are made of, and their forms."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env import layouts


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

    obs_types: Mapping[str, type[layouts.Layout]] = dataclasses.field(default_factory=lambda: layouts.LAYOUTS)
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

    def layout(self, config: ObservationConfig) -> type[layouts.Layout]:
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
        layout: type[layouts.Layout],
        goals: layouts.Goals | None,
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
        parts = layouts.Parts(flat=self.space, robot=self._robot, goals=goals, pictures=self._pictures)
        self.layout: layouts.Layout = layout(parts)
        if goals and goals.further:
            self.layout = layouts.Extended(self.layout, goals)

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

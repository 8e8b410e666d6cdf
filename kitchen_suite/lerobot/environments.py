"""The vectorised environments with the observations and attributes that LeRobot reads; needs no LeRobot.

`configs` registers them with LeRobot.
"""

import contextlib
import functools
import json
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.closing import closed_on_error
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.lerobot.observations import Feature, LeRobotObservations, frames_per_second
from kitchen_suite.vector_env import arguments as vector_arguments
from kitchen_suite.vector_env.base import StepResult, SuiteVectorEnv

_FILM_SIZE = {"width": 320, "height": 240}  # Size of films [pixels].
_BLANK = (64, 64)  # Height and width of a picture in place of a film's, where there is no render mode [pixels].


class LeRobotVectorEnv(gymnasium.vector.VectorEnv):
    """The suite's vectorised environments as LeRobot reads them.

    Observations are dicts of `agent_pos`, `environment_state` and `pixels`, a dict by camera. The next episode starts
    in the step that ends one, and `final_info` has the last infos, among them `is_success`. Every number is that of
    `SuiteVectorEnv`.
    """

    def __init__(self, environments: SuiteVectorEnv) -> None:
        """Adapts environments of autoreset mode `SameStep` and an observation type of `observations.OBS_TYPES`."""
        vector_arguments.autoreset_mode(environments.metadata["autoreset_mode"], AutoresetMode.SAME_STEP)
        self.environments, self.num_envs = environments, environments.num_envs
        self._observations = LeRobotObservations(environments.template_env)
        self.spec, self.render_mode = environments.spec, environments.render_mode
        fps = frames_per_second(environments.template_env)
        self.metadata = {**environments.metadata, "render_fps": fps}
        self.single_action_space = environments.single_action_space
        self.action_space = environments.action_space
        self.single_observation_space = self._observations.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts an episode in every environment; arguments and errors as in `SuiteVectorEnv.reset`."""
        # An episode depends on its seed alone, and not on how many steps an environment has made before.
        self.environments.reset_statistics()
        observations, infos = self.environments.reset(seed=seed, options=options)
        return self._observations(observations), infos

    def step(self, actions: ArrayLike) -> StepResult:
        """Makes a control step; see `SuiteVectorEnv.step`."""
        observations, rewards, terminations, truncations, infos = self.environments.step(actions)
        if "final_obs" in infos:
            last = np.full(self.num_envs, None, dtype=object)
            for i, observation in enumerate(infos["final_obs"]):
                last[i] = None if observation is None else self._observations(observation)
            infos["final_obs"] = last
        return self._observations(observations), rewards, terminations, truncations, infos

    def call(self, name: str, *args: Any, **kwargs: Any) -> Sequence[Any]:
        """Returns an attribute of every environment, or with `render` a picture of each, taken when it is read."""
        if args or kwargs:
            raise TypeError(f"{name} takes no arguments: the environments are stepped together")
        return RenderedPictures(self.environments) if name == "render" else self.environments.call(name)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Returns an attribute of every environment; raises an AttributeError if there is no such attribute."""
        return self.environments.get_attr(name)

    def render(self) -> tuple[NDArray, ...]:
        """Returns a picture `(height, width, 3)` of every environment."""
        return tuple(RenderedPictures(self.environments))

    def close_extras(self, **kwargs: Any) -> None:
        self.environments.close(**kwargs)


class RenderedPictures(Sequence[NDArray[np.uint8]]):
    """Pictures `(height, width, 3)` of environments, rendered when they are read: LeRobot reads only some.

    Pictures are black where the environments have no render mode: LeRobot always asks for them.
    """

    def __init__(self, environments: SuiteVectorEnv) -> None:
        self._environments = environments

    def __len__(self) -> int:
        return self._environments.num_envs

    def __getitem__(self, index: int | slice) -> Any:
        if isinstance(index, int):
            return self[index : index + 1 or None][0]
        indices = range(len(self))[index]
        if self._environments.render_mode is None:
            return tuple(np.zeros((*_BLANK, 3), np.uint8) for _ in indices)
        return self._environments.render_some(indices)


def make_vector_env(
    spec: EnvironmentSpec, num_envs: int, *, num_threads: int | None = None, **rendering: Any
) -> LeRobotVectorEnv:
    """Makes environments for LeRobot, which threads step; `rendering` are further arguments, such as `render_mode`."""
    quality = {} if "render_quality" in spec.task_kwargs else {"render_quality": "fast"}
    size = {name: value for name, value in _FILM_SIZE.items() if name not in spec.task_kwargs}
    arguments = {**quality, **size, **rendering}
    environments = spec.make_vector_env(num_envs, num_threads, AutoresetMode.SAME_STEP, **arguments)
    with closed_on_error([environments]):
        return LeRobotVectorEnv(environments)


def features_of(spec: EnvironmentSpec) -> tuple[tuple[Feature, ...], int]:
    """Returns the features of an environment, and its frames per second [Hz]."""
    return _features_of(json.dumps(spec.as_json()))


@functools.cache
def _features_of(spec: str) -> tuple[tuple[Feature, ...], int]:
    """Returns what `features_of` does, for the JSON of a specification: LeRobot makes configs several times."""
    with contextlib.closing(EnvironmentSpec(**json.loads(spec)).make_environment()) as made:
        environment = suite_env(made)
        return tuple(LeRobotObservations(environment).features), frames_per_second(environment)

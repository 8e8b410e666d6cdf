"""The base of the suite's Gymnasium environments: seeds, states, copies, rendering."""

import abc
import copy
from collections.abc import Mapping
from typing import Any, Self

import dm_env
import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import ArrayLike

from kitchen_suite import checks
from kitchen_suite.environment import Environment

DEFAULT_SIZE = 480  # [pixels], Gymnasium's own

_VISUAL_FLAGS = range(int(mujoco.mjtVisFlag.mjNVISFLAG))
_RENDER_MODES = ("human", "rgb_array", "depth_array")


class SuiteEnv(gymnasium.Env, abc.ABC):
    """A Gymnasium environment over a composer environment of the suite.

    The suite's environment draws from the bit generator of `np_random`, which Gymnasium seeds. A copy made by
    `copy.deepcopy` or pickle continues from the state of the original.
    """

    metadata = {"render_modes": list(_RENDER_MODES)}

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        width: int = DEFAULT_SIZE,
        height: int = DEFAULT_SIZE,
        camera_id: int | None = None,
        camera_name: str | None = None,
        default_camera_config: Mapping[str, Any] | None = None,
        max_geom: int = 1000,
        visual_options: Mapping[int, bool] | None = None,
        max_episode_steps: int | None = None,
        visuals: bool | None = None,
        task_options: Mapping[str, Any],
    ) -> None:
        """Builds the environment.

        Args:
          render_mode: `rgb_array`, `depth_array` (the z-buffer) or `human` (a window); `gymnasium.make` adds
            `rgb_array_list`.
          width: width of images [pixels].
          height: height of images [pixels].
          camera_id: index of the camera; the free camera of `default_camera_config` when omitted.
          camera_name: name of the camera, instead of its index.
          default_camera_config: attributes of the free camera.
          max_geom: maximum number of geoms in an image.
          visual_options: values of MuJoCo's visualisation flags (`mujoco.mjtVisFlag`).
          max_episode_steps: control steps after which the environment itself truncates; `gymnasium.make` counts
            separately.
          visuals: whether to build geoms and textures that only rendering needs; when omitted, only with a render mode.
          task_options: arguments of the domain's builder in `kitchen_suite.suite`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown name, or a number out of range.
        """
        self._render_settings: dict[str, Any] = {
            "default_cam_config": self._checked_camera_config(default_camera_config),
            "width": checks.integer(width, "width", minimum=1),
            "height": checks.integer(height, "height", minimum=1),
            "camera_id": camera_id,
            "camera_name": camera_name,
            "max_geom": checks.integer(max_geom, "max_geom", minimum=1),
            "visual_options": self._checked_visual_options(visual_options),
        }
        self.render_mode = None if render_mode is None else self._checked_render_mode(render_mode)
        if max_episode_steps is not None:
            checks.integer(max_episode_steps, "max_episode_steps", minimum=1)
        self._max_episode_steps = max_episode_steps
        with_visuals = render_mode is not None if visuals is None else checks.boolean(visuals, "visuals")
        self._environment = self._make_environment({"visuals": with_visuals, "time_limit": None, **task_options})
        self._check_camera(camera_id, camera_name)
        self._renderer: MujocoRenderer | None = None
        self._bound_random: np.random.Generator | None = None
        self._episode_step = 0

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Stores the arguments, from which copies are built."""
        self = super().__new__(cls)
        self._arguments = copy.deepcopy((args, kwargs))
        return self

    @abc.abstractmethod
    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        """Builds the suite's environment from arguments of the domain's builder."""

    @abc.abstractmethod
    def _default_camera_config(self) -> dict[str, Any]:
        """Returns the attributes of the free camera."""

    @abc.abstractmethod
    def _get_obs(self, observation: Mapping[str, np.ndarray]) -> Any:
        """Converts an observation of the suite's environment to the observation space."""

    @abc.abstractmethod
    def _get_info(self) -> dict[str, Any]:
        """Returns the info of the last step or reset, in fresh lists and arrays."""

    @abc.abstractmethod
    def suite_observation(self, observation: Any) -> dict[str, np.ndarray]:
        """Converts an observation of this environment's observation space to the suite's own, in fresh arrays.

        It has the keys and the order of `task.task_observables`, which policies expect.
        """

    @property
    def environment(self) -> Environment:
        """The suite's environment."""
        return self._environment

    @property
    def max_episode_steps(self) -> int | None:
        """Control steps after which the environment itself truncates; None if it never does."""
        return self._max_episode_steps

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode.

        Args:
          seed: seed of the random stream, of any size; the stream continues when omitted.
          options: `{"state": ...}` continues from a state returned by `get_state`; a seed beside it replaces only the
            random state.

        Raises:
          TypeError: the seed is no integer, or the options are no dict.
          ValueError: the seed is negative, an option is unknown, or the state does not fit.
        """
        if seed is not None:
            checks.integer(seed, "seed", minimum=0)
        state = self._checked_options(options).get("state")
        if isinstance(state, Mapping) and state.get("reset_next_step"):
            raise ValueError("the state is of no episode: it was saved before a reset, or after the physics diverged")
        if state is not None:
            observation = self.set_state(state)
        super().reset(seed=seed)
        self._bind_random_state()
        if state is None:
            self._episode_step = 0
            observation = self._get_obs(self._environment.reset().observation)
        self._render_window()
        return observation, self._get_info()

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Makes one control step.

        A step after termination continues the episode. A step after a `PhysicsError` starts a new episode instead, with
        reward 0 and whatever the action.

        Raises:
          TypeError: the action does not hold real numbers.
          ValueError: the action has the wrong shape, or holds NaN or inf; nothing has changed then.
        """
        self._bind_random_state()
        timestep = self._environment.step(action)
        self._episode_step = 0 if timestep.first() else self._episode_step + 1
        terminated = self._terminated_and_continue(timestep)
        truncated = self._max_episode_steps is not None and self._episode_step >= self._max_episode_steps
        self._render_window()
        reward = 0.0 if timestep.first() else float(timestep.reward)
        return self._get_obs(timestep.observation), reward, terminated, truncated, self._get_info()

    def get_state(self) -> dict[str, Any]:
        """Returns the state on which later steps depend, as nested dicts of strings, numbers and arrays."""
        self._bind_random_state()
        return {**self._environment.get_state(), "episode_step": self._episode_step}

    def set_state(self, state: Mapping[str, Any]) -> Any:
        """Sets a state returned by `get_state` of this environment, or of another one built with the same arguments.

        Returns:
          The observation.

        Raises:
          TypeError: a part of the state has the wrong type.
          ValueError: a part of the state is missing, has the wrong shape or is not finite; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict returned by get_state, got {state!r}")
        step = checks.integer(state.get("episode_step"), "state['episode_step']", minimum=0)
        self._bind_random_state()
        inner = {key: value for key, value in state.items() if key != "episode_step"}
        observation = self._get_obs(self._environment.set_state(inner))
        self._episode_step = step
        return observation

    def render(self) -> np.ndarray | None:
        """Returns an image `(height, width, 3)` uint8, or depth `(height, width)` float32, by `render_mode`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; pass one to the constructor")
            return None
        if self._renderer is None:
            self._renderer = self._make_renderer()
        return self._renderer.render(self.render_mode)

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": self._arguments,
            "state": self.get_state(),
            "seed": self._np_random_seed,
            "spec": self.spec,
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self._arguments = args, kwargs = state["arguments"]
        type(self).__init__(self, *args, **kwargs)
        self.spec = state["spec"]
        bit_generator = getattr(np.random, state["state"]["random"]["bit_generator"])
        self.np_random = np.random.Generator(bit_generator())
        self.set_state(state["state"])
        self._np_random_seed = state["seed"]

    def _terminated_and_continue(self, timestep: dm_env.TimeStep) -> bool:
        """Returns whether the step terminated. If so, the next step continues the episode, as in FrankaKitchen-v1."""
        if terminated := timestep.last():
            self._environment.continue_episode()
        return terminated

    def _bind_random_state(self) -> None:
        """Makes the suite's environment draw from `np_random`, which Gymnasium replaces at each seeding."""
        if self._bound_random is not self.np_random:
            self._bound_random = self.np_random
            self._environment.random_state = np.random.RandomState(self.np_random.bit_generator)

    def _render_window(self) -> None:
        if self.render_mode == "human":
            self.render()

    def _make_renderer(self) -> MujocoRenderer:
        model, data = self._environment.physics.model.ptr, self._environment.physics.data.ptr
        framebuffer = model.vis.global_
        framebuffer.offwidth = max(framebuffer.offwidth, self._render_settings["width"])
        framebuffer.offheight = max(framebuffer.offheight, self._render_settings["height"])
        return MujocoRenderer(model, data, **self._render_settings)

    def _check_camera(self, camera_id: int | None, camera_name: str | None) -> None:
        model = self._environment.physics.model
        names = [model.camera(i).name for i in range(model.ncam)]
        if camera_name is not None and camera_id is not None:
            raise ValueError(f"pass camera_id or camera_name, not both: {camera_id!r}, {camera_name!r}")
        if camera_name is not None:
            checks.choice(camera_name, names, "camera_name")
        if camera_id is not None and checks.integer(camera_id, "camera_id", minimum=-1) >= len(names):
            raise ValueError(f"camera_id must be below {len(names)}, got {camera_id}; the cameras are {names}")

    def _checked_camera_config(self, config: Mapping[str, Any] | None) -> dict[str, Any]:
        if config is None:
            return self._default_camera_config()
        if not isinstance(config, Mapping):
            raise TypeError(f"default_camera_config must be a dict, got {config!r}")
        names = [name for name in dir(mujoco.MjvCamera) if not name.startswith("_")]
        return {checks.choice(name, names, "camera attribute"): value for name, value in config.items()}

    @staticmethod
    def _checked_visual_options(options: Mapping[int, bool] | None) -> dict[int, bool]:
        if options is not None and not isinstance(options, Mapping):
            raise TypeError(f"visual_options must be a dict, got {options!r}")
        if odd := [flag for flag in options or {} if flag not in _VISUAL_FLAGS]:
            raise ValueError(
                f"visual_options must be numbers of mujoco.mjtVisFlag, 0 to {_VISUAL_FLAGS[-1]}, got {odd}"
            )
        return {int(flag): checks.boolean(value, "visual option") for flag, value in (options or {}).items()}

    @staticmethod
    def _checked_render_mode(render_mode: str) -> str:
        if render_mode == "rgb_array_list":
            raise ValueError("render_mode 'rgb_array_list' needs gymnasium.make; use 'rgb_array' here")
        return checks.choice(render_mode, _RENDER_MODES, "render_mode")

    @staticmethod
    def _checked_options(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
        if options is not None and not isinstance(options, Mapping):
            raise TypeError(f"options must be a dict, got {options!r}")
        for name in options or {}:
            checks.choice(name, ("state",), "option")
        return options or {}


def suite_env(environment: gymnasium.Env) -> SuiteEnv:
    """Returns the suite's environment within Gymnasium's wrappers."""
    inner = environment.unwrapped
    assert isinstance(inner, SuiteEnv)
    return inner

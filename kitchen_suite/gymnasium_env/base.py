"""What every Gymnasium environment of the suite shares: seeds, states, copies, pictures."""

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
    """A Gymnasium environment over one of the suite's.

    The random state of the suite's environment draws from `np_random`, so seeds mean what they mean in Gymnasium. A
    copy made by `copy.deepcopy` or pickle goes on where the original stands.
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
          render_mode: what `render` gives: `rgb_array`, `depth_array` (the z-buffer), or with `human` a window.
            `gymnasium.make` adds `rgb_array_list`.
          width: of pictures [pixels].
          height: of pictures [pixels].
          camera_id: number of the camera; by default the free camera of `default_camera_config`.
          camera_name: name of the camera, in place of its number.
          default_camera_config: attributes of the free camera.
          max_geom: how many geoms a picture has room for.
          visual_options: flags of MuJoCo's visualiser (`mujoco.mjtVisFlag`) to be set.
          max_episode_steps: control steps until the environment itself truncates; `gymnasium.make` counts by itself.
          visuals: whether to build what only the eye needs; by default where there is a render mode.
          task_options: arguments of the suite's builder.

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
        """Notes the arguments, which a copy is built from."""
        self = super().__new__(cls)
        self._arguments = copy.deepcopy((args, kwargs))
        return self

    @abc.abstractmethod
    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        """Builds the suite's environment."""

    @abc.abstractmethod
    def _default_camera_config(self) -> dict[str, Any]:
        """Attributes of the free camera."""

    @abc.abstractmethod
    def _get_obs(self, observation: Mapping[str, np.ndarray]) -> Any:
        """Turns an observation of the suite's environment into one of the observation space."""

    @abc.abstractmethod
    def _get_info(self) -> dict[str, Any]:
        """Makes the info of the last step or reset, of fresh lists and arrays."""

    @property
    def environment(self) -> Environment:
        """The suite's environment."""
        return self._environment

    @property
    def max_episode_steps(self) -> int | None:
        """Control steps until the environment itself truncates, if it does."""
        return self._max_episode_steps

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode.

        Args:
          seed: starts the random stream anew; of any size.
          options: `{"state": ...}` goes on from a state that `get_state` gave; a seed given with it replaces only the
            random state.

        Raises:
          TypeError: the seed is no integer, or the options are no dict.
          ValueError: the seed is negative, an option is unknown, or the state does not fit.
        """
        if seed is not None:
            checks.integer(seed, "seed", minimum=0)
        state = self._checked_options(options).get("state")
        if state is not None:
            if isinstance(state, Mapping) and state.get("reset_next_step"):
                raise ValueError(
                    "the state is of no episode: it was taken before a reset, or after the physics diverged"
                )
            observation = self.set_state(state)
            super().reset(seed=seed)
            self._bind_random_state()
        else:
            super().reset(seed=seed)
            self._bind_random_state()
            self._episode_step = 0
            observation = self._get_obs(self._environment.reset().observation)
        self._render_window()
        return observation, self._get_info()

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Makes one control step.

        A step after termination goes on in the same episode; one after a `PhysicsError` starts a new one, reward 0.

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
        """All that the future depends on, as nested dicts of numbers and arrays."""
        self._bind_random_state()
        return {**self._environment.get_state(), "episode_step": self._episode_step}

    def set_state(self, state: Mapping[str, Any]) -> Any:
        """Takes up what `get_state` gave, here or in an environment built with the same arguments.

        Returns:
          The observation.

        Raises:
          TypeError: something in the state is of the wrong type.
          ValueError: something in it is missing, has the wrong shape or is not finite; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict that get_state gave, got {state!r}")
        step = checks.integer(state.get("episode_step"), "state['episode_step']", minimum=0)
        self._bind_random_state()
        inner = {key: value for key, value in state.items() if key != "episode_step"}
        observation = self._get_obs(self._environment.set_state(inner))
        self._episode_step = step
        return observation

    def render(self) -> np.ndarray | None:
        """Gives a picture `(height, width, 3)` uint8, or depth `(height, width)` float32, by `render_mode`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; give one to the constructor")
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
        """Whether the step terminated; if so, the next one will go on as the original's does."""
        if terminated := timestep.last():
            self._environment.continue_episode()
        return terminated

    def _bind_random_state(self) -> None:
        """Lets the suite's environment draw from `np_random`, which Gymnasium replaces at each seeding."""
        if self._bound_random is not self.np_random:
            self._bound_random = self.np_random
            self._environment.random_state = np.random.RandomState(self.np_random.bit_generator)

    def _render_window(self) -> None:
        if self.render_mode == "human":
            self.render()

    def _make_renderer(self) -> MujocoRenderer:
        model, data = self._environment.physics.model.ptr, self._environment.physics.data.ptr
        room = model.vis.global_
        room.offwidth = max(room.offwidth, self._render_settings["width"])
        room.offheight = max(room.offheight, self._render_settings["height"])
        return MujocoRenderer(model, data, **self._render_settings)

    def _check_camera(self, camera_id: int | None, camera_name: str | None) -> None:
        model = self._environment.physics.model
        names = [model.camera(i).name for i in range(model.ncam)]
        if camera_name is not None and camera_id is not None:
            raise ValueError(f"give camera_id or camera_name, not both: {camera_id!r}, {camera_name!r}")
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
            raise ValueError("render_mode 'rgb_array_list' comes from gymnasium.make; build with 'rgb_array' here")
        return checks.choice(render_mode, _RENDER_MODES, "render_mode")

    @staticmethod
    def _checked_options(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
        if options is not None and not isinstance(options, Mapping):
            raise TypeError(f"options must be a dict, got {options!r}")
        for name in options or {}:
            checks.choice(name, ("state",), "option")
        return options or {}


def suite_env(environment: gymnasium.Env) -> SuiteEnv:
    """The suite's own environment within wrappers."""
    inner = environment.unwrapped
    assert isinstance(inner, SuiteEnv)
    return inner

"""The base of the suite's Gymnasium environments: seeds, states, copies, rendering."""

import abc
import copy
import dataclasses
import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Self

import gymnasium
import numpy as np
from dm_env import specs
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env import observations, rendering
from kitchen_suite.gymnasium_env.observations import ObservationConfig, Observations, ObservationSettings
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.tasks.variations.variations import Variations


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControlSettings:
    """Arguments of the Gymnasium environments that choose what the action means.

    See docs/control_modes.md for all modes, and for the arguments that belong to each.

    Attributes:
      control_mode: meaning of the action, such as `ee_delta_pose`; the domain's own when None.
      linear_speed: speed that a unit of action stands for in the modes of the end effector [m/s].
      angular_speed: angular speed that a unit of action stands for in `ee_delta_pose` [rad/s].
      joint_speed: joint speed that a unit of action stands for in `joint_delta` [rad/s].
      frame: `base` or `hand`: the axes of changes in the modes of the end effector.
    """

    control_mode: str | None = None
    linear_speed: float | None = None
    angular_speed: float | None = None
    joint_speed: float | None = None
    frame: str | None = None

    def task_options(self) -> dict[str, Any]:
        """Returns the arguments of the task."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value is not None}


def action_space(spec: specs.Array) -> spaces.Box:
    """Returns the space of actions of a spec, in single precision."""
    bounds = (spec.minimum, spec.maximum) if isinstance(spec, specs.BoundedArray) else (-np.inf, np.inf)
    low, high = (np.broadcast_to(bound, spec.shape).astype(np.float32) for bound in bounds)
    return spaces.Box(low, high, dtype=np.float32)


class CopiedEnv(gymnasium.Env):
    """An environment that is copied by its arguments and its state."""

    @abc.abstractmethod
    def get_state(self) -> dict[str, Any]:
        """Returns the state on which later steps depend."""

    @abc.abstractmethod
    def set_state(self, state: Mapping[str, Any]) -> Any:
        """Sets a state that `get_state` returned."""

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Stores the arguments, from which copies are built."""
        self = super().__new__(cls)
        self._arguments = copy.deepcopy((args, kwargs))
        return self

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


class InstructedEnv:
    """An environment with the instructions of its task.

    Attributes:
      task: the instruction, under the name of LeRobot's environments and data sets.
      task_description: the instruction, under the other name that LeRobot reads.
    """

    _environment: Environment

    @property
    def instruction(self) -> str:
        """The task's sentence; the empty string if the task has none."""
        return self._environment.task.instruction

    @property
    def instructions(self) -> tuple[str, ...]:
        """The task's sentence, then paraphrases of it."""
        return self._environment.task.instructions

    task = task_description = instruction


# Options of `reset`: of every environment, of single ones alone, and of vectorised ones alone.
VARIATION, VARIATION_VALUES = "variation", "variation_values"
STATE, RESET_MASK = "state", "reset_mask"

# Key of infos that hold strings.
VARIATION_SPLIT = "variation_split"


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariationSettings:
    """Arguments of the Gymnasium environments that choose what varies from episode to episode.

    See docs/variations.md for all parameters.

    Attributes:
      variations: names of groups, such as `start`, alone, in a sequence or joined by commas; or distributions by
        parameter, also as JSON describes them. Nothing varies when None.
      variation_split: `seen` or `held_out`: which distributions the groups have.
    """

    variations: Any = None
    variation_split: str = "seen"

    def task_options(self) -> dict[str, Any]:
        """Returns the arguments of the task that differ from its defaults."""
        values = ((field.name, getattr(self, field.name), field.default) for field in dataclasses.fields(self))
        return {name: value for name, value, default in values if value is not default}


def space_of(variations: Variations) -> spaces.Dict:
    """Returns the space of the parameters that vary in a task, by name."""
    boxes: dict[str, spaces.Space] = {
        name: spaces.Box(low, high, low.shape, np.float64) for name, (low, high) in variations.ranges.items()
    }
    return spaces.Dict(boxes)


def request(task: SuiteTask, options: Mapping[str, Any]) -> None:
    """Makes a task's next reset follow the options of a reset.

    Raises as `Variations.request` and `OptionedTask.reset_request`; the task is unchanged then.
    """
    own = task.reset_request(options)
    chosen = task.variations.request(options.get(VARIATION), options.get(VARIATION_VALUES))
    task.variations.follow(chosen)
    task.request_reset(own)


class VariedEnv:
    """An environment with the variations of its task."""

    _environment: Environment

    @property
    def variation_space(self) -> spaces.Dict:
        """Ranges of the parameters that vary, by name; empty if nothing varies."""
        return space_of(self._environment.task.variations)

    @property
    def variation_values(self) -> dict[str, Any]:
        """Values of these parameters in the present episode, in fresh arrays."""
        return self._environment.task.variations.values

    @property
    def variation_split(self) -> str:
        """`seen` or `held_out`."""
        return self._environment.task.variations.split


# Classes whose attributes are keyword arguments of every environment.
CHOICES = (ObservationSettings, ControlSettings, VariationSettings)

# Their values where they are omitted.
DEFAULTS: Mapping[str, Any] = MappingProxyType(
    {field.name: field.default for kind in CHOICES for field in dataclasses.fields(kind)}
)


def split_choices(choices: Mapping[str, Any]) -> tuple[ObservationSettings, ControlSettings, VariationSettings]:
    """Returns what arguments choose of observation, control mode and variations; each is an attribute of `CHOICES`."""
    observation, control, variation = (
        {field.name: choices[field.name] for field in dataclasses.fields(kind) if field.name in choices}
        for kind in CHOICES
    )
    return ObservationSettings(**observation), ControlSettings(**control), VariationSettings(**variation)


DEFAULT_SIZE = 480  # [pixels], Gymnasium's own


class SuiteEnv(InstructedEnv, VariedEnv, CopiedEnv, abc.ABC):
    """A Gymnasium environment over a composer environment of the suite.

    The suite's environment draws from the bit generator of `np_random`, which Gymnasium seeds. A copy made by
    `copy.deepcopy` or pickle continues from the state of the original.

    Attributes:
      observed: what the environments of the domain observe.
    """

    observed: ClassVar[ObservationConfig] = ObservationConfig()

    metadata = {"render_modes": list(rendering.RENDER_MODES)}

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
        render_quality: str = "high",
        task_options: Mapping[str, Any],
        **choices: Any,
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
          visuals: whether to build geoms and textures that only pictures need; when omitted, where there are pictures.
          render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling, and with fewer
            faces; see `rendering.quality.set_render_quality`.
          task_options: arguments of the domain's builder in `kitchen_suite.suite`.
          **choices: attributes of `ObservationSettings`, such as `obs_type` and `cameras`, of `ControlSettings`, such
            as `control_mode`, and of `VariationSettings`, such as `variations`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        self.check_keywords(choices)
        settings, control, variation = split_choices(choices)
        layout, observables = settings.layout(self.observed), settings.task_options(self.observed)
        chosen = {**control.task_options(), **variation.task_options()}
        camera_config = self._default_camera_config() if default_camera_config is None else default_camera_config
        self._renderer = rendering.Renderer(
            width=width,
            height=height,
            camera_id=camera_id,
            camera_name=camera_name,
            default_camera_config=camera_config,
            max_geom=max_geom,
            visual_options=visual_options,
        )
        self.render_mode = None if render_mode is None else rendering.checked_render_mode(render_mode)
        if max_episode_steps is not None:
            checks.integer(max_episode_steps, "max_episode_steps", minimum=1)
        self._max_episode_steps = max_episode_steps
        with_pictures = render_mode is not None or layout.has_pictures
        with_visuals = with_pictures if visuals is None else checks.boolean(visuals, "visuals")
        options = {"visuals": with_visuals, "render_quality": render_quality, "time_limit": None}
        self._environment = self._make_environment({**options, **chosen, **observables, **task_options})
        self.action_space = action_space(self._environment.action_spec())
        self._renderer.check_camera(self._environment)
        self._task = self._environment.task
        self._observations = Observations(self._environment, self.observed, layout, self._make_goals())
        self.observation_space = self._observations.layout.space
        self._bound_random: np.random.Generator | None = None
        self._episode_step = 0

    @classmethod
    def check_keywords(cls, names: Iterable[str], exclude: Iterable[str] = ()) -> None:
        """Checks that the constructor has keyword arguments of given names.

        Args:
          names: of the arguments.
          exclude: arguments that are set otherwise.

        Raises:
          TypeError: there is no such argument.
        """
        constructors = [vars(base)["__init__"] for base in cls.__mro__ if "__init__" in vars(base)]
        # TorchRL tries arguments of its own, and drops one if the error is "unexpected keyword argument" and its name.
        others = {"self", "task_options", *exclude}
        checks.keywords(names, *constructors, *CHOICES, what="keyword argument", exclude=others)

    @abc.abstractmethod
    def _make_environment(self, task_options: Mapping[str, Any]) -> Environment:
        """Builds the suite's environment from arguments of the domain's builder."""

    @abc.abstractmethod
    def _default_camera_config(self) -> dict[str, Any]:
        """Returns the attributes of the free camera."""

    def _make_goals(self) -> observations.Goals | None:
        """Returns the layout of the goals; None in a domain without goals."""
        return None

    def _get_obs(self, observation: Mapping[str, np.ndarray]) -> Any:
        """Converts an observation of the suite's environment to the observation space."""
        self._observation = observation
        own = self._observations
        return own.layout(own.flat(observation), self._task.state, observation)

    @abc.abstractmethod
    def _get_info(self) -> dict[str, Any]:
        """Returns the info of the last step or reset, in fresh lists and arrays."""

    def _info(self) -> dict[str, Any]:
        """Returns the infos of the task and of its variation."""
        return {**self._get_info(), **self._task.variations.info}

    def clip_actions(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns actions `(..., k)` as they are applied."""
        return actions

    @property
    def observations(self) -> Observations:
        """Converts between the forms of observations."""
        return self._observations

    @property
    def present_observation(self) -> dict[str, NDArray]:
        """The present observation as the suite's own, which policies expect, whatever the observation type."""
        own, present = self._observations, self._observation
        return own.suite_layout(own.flat(present), self._task.state, present)

    def __repr__(self) -> str:
        settings = f"render_mode={self.render_mode!r}, max_episode_steps={self._max_episode_steps}"
        return f"{type(self).__name__}({self._environment.task!r}, {settings})"

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
            random state. `{"variation": names}` has the parameters and groups that vary in this episode, of those of
            `variations`; the others have their defaults. `{"variation_values": {name: value}}` replaces values that
            would be drawn. A task may have options of its own; see its environment. Options that no environment of
            the suite has are ignored.

        Raises:
          TypeError: the seed is no integer, or the options are no dict.
          ValueError: the seed is negative, the state does not fit, or an option is none of these and spelt much like
            one of them.
        """
        if seed is not None:
            checks.integer(seed, "seed", minimum=0)
        names = (STATE, VARIATION, VARIATION_VALUES, *self._task.reset_options)
        chosen = checks.reset_options(options, names, elsewhere=(RESET_MASK,))
        state = chosen.get(STATE)
        if state is None:
            request(self._task, chosen)
        elif len(chosen) > 1:
            others = " and ".join((VARIATION, VARIATION_VALUES, *self._task.reset_options))
            raise ValueError(f"a state has its own values: leave out {others}")
        if isinstance(state, Mapping) and state.get("reset_next_step"):
            raise ValueError("the state is of no episode: it was saved before a reset, or after the physics diverged")
        if state is not None:
            observation = self.set_state(state)
        # Not that of gymnasium-robotics' GoalEnv, which refuses observations without goals.
        gymnasium.Env.reset(self, seed=seed)
        self._bind_random_state()
        if state is None:
            self._episode_step = 0
            observation = self._get_obs(self._environment.reset().observation)
        self._render_window()
        return observation, self._info()

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
        if timestep.last():
            # The next step continues the episode, as in FrankaKitchen-v1.
            self._environment.continue_episode()
        terminated = timestep.last() and timestep.discount == 0.0
        at_limit = self._max_episode_steps is not None and self._episode_step >= self._max_episode_steps
        self._render_window()
        reward = 0.0 if timestep.first() else float(timestep.reward)
        return self._get_obs(timestep.observation), reward, terminated, at_limit or self._task.truncates, self._info()

    def get_state(self) -> dict[str, Any]:
        """Returns the state on which later steps depend, as nested dicts of strings, numbers and arrays."""
        self._bind_random_state()
        return {**self._environment.get_state(), "episode_step": self._episode_step}

    def set_state(self, state: Mapping[str, Any]) -> Any:
        """Sets a state returned by `get_state` of this environment, or of another one built with the same arguments.

        Arguments of rendering may differ: a state of an environment without a render mode can be set in one with it.

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
        return self._renderer.render(self._environment, self.render_mode)

    def close(self) -> None:
        self._renderer.close()
        if self._observations.layout.has_pictures:
            self._environment.physics.free_context()

    def _bind_random_state(self) -> None:
        """Makes the suite's environment draw from `np_random`, which Gymnasium replaces at each seeding."""
        if self._bound_random is not self.np_random:
            self._bound_random = self.np_random
            self._environment.random_state = np.random.RandomState(self.np_random.bit_generator)

    def _render_window(self) -> None:
        if self.render_mode == "human":
            self.render()


def suite_env(environment: gymnasium.Env) -> SuiteEnv:
    """Returns the suite's environment within Gymnasium's wrappers."""
    inner = environment.unwrapped
    assert isinstance(inner, SuiteEnv)
    return inner


class FlatEnv(SuiteEnv):
    """An environment whose observation is one array, and whose infos are arrays of shape `()`.

    Infos are those of the task's MDP, and `episode_step`, the number of control steps.
    """

    def __init__(self, *, action_limit: float | None, task_options: Mapping[str, Any], **settings: Any) -> None:
        """Builds the environment.

        Args:
          action_limit: bound of the action space of `joint_offset`, to which actions are clipped; without bounds when
            None. The other control modes have bounds of their own.
          task_options: arguments of the domain's builder.
          **settings: further arguments of `SuiteEnv`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        limit = math.inf if action_limit is None else checks.number(action_limit, "action_limit", positive=True)
        super().__init__(task_options=task_options, **settings)
        (self._action_size,) = self._environment.action_spec().shape
        # Modes with bounds of their own need no other.
        has_bounds = isinstance(self._environment.action_spec(), specs.BoundedArray)
        self._action_limit = math.inf if has_bounds else limit
        if not has_bounds:
            self.action_space = spaces.Box(-limit, limit, (self._action_size,), np.float32)

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Makes one control step; see `SuiteEnv.step`."""
        if self._action_limit < math.inf:
            # NaN and inf must not be clipped away: check first. Without a limit only the task checks.
            action = self.clip_actions(checks.vector(action, self._action_size, "action"))
        return super().step(action)

    def clip_actions(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns actions `(..., k)` clipped to the `action_limit`, if there is one."""
        return actions if self._action_limit == math.inf else actions.clip(-self._action_limit, self._action_limit)

    def _get_info(self) -> dict[str, Any]:
        return {**self._task.mdp.info(self._task.state), "episode_step": np.array(self._episode_step)}

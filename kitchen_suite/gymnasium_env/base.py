"""The Gymnasium environment of the suite's domains: spaces, seeds, states, copies, rendering."""

import copy
import inspect
import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any, ClassVar, Self

import gymnasium
import numpy as np
from dm_env import specs
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks, suite
from kitchen_suite.domains.argument_hints import LOAD_ONLY
from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment import Environment
from kitchen_suite.environment.seeds import EpisodeSeeds
from kitchen_suite.gymnasium_env import observations
from kitchen_suite.gymnasium_env.observations import Observations, Present
from kitchen_suite.gymnasium_env.renderer import RENDER_MODES, Renderer, checked_render_mode
from kitchen_suite.physics_names import PHYSICS_KEY
from kitchen_suite.rendering import cameras
from kitchen_suite.tasks.pictures import DEFAULT_SIZE as IMAGE_SIZE
from kitchen_suite.tasks.requests import VARIATION, VARIATION_VALUES

# Option of a reset of single environments.
STATE = "state"

# Option of a reset of vectorised environments.
RESET_MASK = "reset_mask"

# Keys of infos that hold strings.
VARIATION_SPLIT = "variation_split"
INSTRUCTION = "instruction"

DEFAULT_SIZE = 480  # [pixels], Gymnasium's own


class SuiteEnv(gymnasium.Env):
    """A task of the suite as a Gymnasium environment.

    The suite's environment draws from the bit generator of `np_random`, which Gymnasium seeds. A copy made by
    `copy.deepcopy` or pickle continues from the state of the original.

    Observation: one array, or a dict by `obs_type`; see docs/guide/observations.md.
    Info: that of the task's MDP, in arrays of shape `()`, and `episode_step`, the number of control steps. With
      `instructions=True` also `instruction`, the task's sentence, a string.

    Attributes:
      environment: the suite's environment.
      composer_task: its task; `task` is its sentence, as LeRobot expects.
      max_episode_steps: control steps after which the environment itself truncates; None if it never does.
      observations: converts between the forms of observations.
      renderer: makes the images of `render`.
      clips_actions: whether actions have to be clipped to the `action_limit`.
      varies: whether parameters vary from episode to episode.
      has_instructions: whether infos have the task's sentence.
      default_domain: name of the domain where none is given; empty for a class of any domain.
      obs_types: names of the observation types; the first is the default.
      default_cameras: cameras of the observation types with pictures where none are named.
      observation_dtype: type of the flat observation.
      free_camera: attributes of the free camera.
      array_options: arguments with which infos are arrays of fixed shape alone, which can be recorded.
      flat_options: arguments with which goals are arrays as well, as a network needs them.
      goal_options: names of the arguments on which the meaning of observed goals depends.
      environment_options: further arguments of the suite's environment.
    """

    metadata = {"render_modes": list(RENDER_MODES)}
    default_domain: ClassVar[str] = ""
    obs_types: ClassVar[tuple[str, ...]] = tuple(name for name in observations.OBS_TYPES if name != "goal")
    default_cameras: ClassVar[tuple[str, ...]] = ("overview",)
    observation_dtype: ClassVar[type[np.floating]] = np.float32
    free_camera: ClassVar[Mapping[str, Any]] = {"distance": 2.5, "azimuth": 125.0, "elevation": -25.0}
    array_options: ClassVar[Mapping[str, Any]] = {}
    flat_options: ClassVar[Mapping[str, Any]] = {}
    goal_options: ClassVar[tuple[str, ...]] = ()
    environment_options: ClassVar[Mapping[str, Any]] = {}

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """Stores the arguments, from which copies are built."""
        self = super().__new__(cls)
        try:
            self._arguments = copy.deepcopy((args, kwargs))
        except RecursionError as error:
            raise ValueError(f"an argument is nested too deeply: {checks.shown(kwargs)}") from error
        except TypeError as error:  # Of a generator, for example.
            raise TypeError(f"an argument cannot be copied: {checks.shown(kwargs)}: {error}") from error
        return self

    def __init__(
        self,
        *,
        domain: str | None = None,
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
        render_quality: str | None = None,
        physics: str | None = None,
        control_timestep: float | None = None,
        quality: bool = False,
        obs_type: str | None = None,
        action_limit: float | None = None,
        episode_seeds: bool | int = False,
        instructions: bool = False,
        **arguments: Any,
    ) -> None:
        """Builds the environment; a bad argument raises a TypeError or ValueError that names it.

        Args:
          domain: name of the domain; that of the class when omitted.
          render_mode: `rgb_array`, `depth_array` (the z-buffer) or `human` (a window); `gymnasium.make` adds
            `rgb_array_list`.
          width: width of images [pixels], at most 4096.
          height: height of images [pixels], at most 4096.
          camera_id: index of the camera; the free camera of `default_camera_config` when omitted.
          camera_name: name of the camera, instead of its index.
          default_camera_config: attributes of the free camera.
          max_geom: maximum number of geoms in an image.
          visual_options: values of MuJoCo's visualisation flags (`mujoco.mjtVisFlag`).
          max_episode_steps: control steps after which the environment itself truncates; `gymnasium.make` counts
            separately.
          visuals: whether to build geoms and textures that only pictures need; when omitted, where there are pictures.
          render_quality: `high`, or `fast`, without shadows, reflections and sky; when omitted, `fast` where images are
            those of `render()` alone, and `high` where images are observed. Both are of one model.
          physics: `exact` or `fast`, see docs/guide/fast_physics.md; the domain's when omitted. With `fast`, infos have
            `physics`; where a scene has free objects, `holding` names the options that hold them.
          control_timestep: length of a control step [s], a whole number of physics steps; the domain's when omitted.
            Where it is another one, infos have `control_timestep`. Step limits stay as many control steps.
          quality: whether infos also say how well the episode has been done up to now: contact forces, objects that
            nobody asked to move, energy, and the path of the hand; see docs/guide/quality.md.
          obs_type: observation type, such as `pixels_agent_pos`; when omitted the first of `obs_types`: `goal` in the
            kitchen, `state` elsewhere; see docs/guide/observations.md.
          action_limit: bound of the action space, for agents that need a finite one, to which actions are clipped; of
            control modes without bounds of their own. The space is unbounded when omitted.
          episode_seeds: whether each reset without a seed has the next seed, which `np_random_seed` names: episode `k`
            after `reset(seed=s)` is then that of `reset(seed=s + k)`, whatever the lengths of those before it, and the
            one that `kitchen-record` plays as its `k`-th. A number is the distance between these seeds. Without it all
            episodes after a seed draw from one stream.
          instructions: whether infos have the task's sentence as `instruction`, a string.
          **arguments: of the domain's scene and task, among them `control_mode` with its arguments, `cameras`,
            `extra_observables` and `variations`; docs/guide/arguments.md lists those of each domain.
        """
        record = suite.find_domain(self.default_domain if domain is None else domain)
        self._check_domain(record)
        arguments = self._keep_contents(record, arguments)
        self._seeds = EpisodeSeeds(episode_seeds)
        physics = record.physics if physics is None else physics
        self.check_keywords(record, arguments)
        obs_type = self.find_obs_type(obs_type)
        with_pictures = observations.has_pictures(obs_type)
        options = observations.picture_options(arguments, obs_type, self.obs_types, self.default_cameras)
        self.renderer = Renderer(
            width=width,
            height=height,
            camera_id=camera_id,
            camera_name=camera_name,
            default_camera_config=self.free_camera if default_camera_config is None else default_camera_config,
            max_geom=max_geom,
            visual_options=visual_options,
        )
        self.render_mode = None if render_mode is None else checked_render_mode(render_mode)
        if max_episode_steps is not None:
            checks.integer(max_episode_steps, "max_episode_steps", minimum=1)
        # LeRobot reads it with the underscore.
        self.max_episode_steps = self._max_episode_steps = max_episode_steps
        limit = math.inf if action_limit is None else checks.number(action_limit, "action_limit", positive=True)
        with_visuals = render_mode is not None or with_pictures
        self.has_instructions = checks.boolean(instructions, "instructions")
        if render_quality is None and (with_pictures or render_mode is None):
            render_quality = "high"
        self.environment: Environment = record.load(
            time_limit=None,
            visuals=with_visuals if visuals is None else checks.boolean(visuals, "visuals"),
            render_quality=render_quality,
            physics=physics,
            control_timestep=control_timestep,
            quality=quality,
            environment_kwargs=self.environment_options,
            **options,
        )
        self.composer_task = self.environment.task
        observations.check_extras(self.composer_task, obs_type, self.obs_types)
        spec = self.environment.action_spec()
        (self._action_size,) = spec.shape
        # The limit is for control modes without bounds.
        self._action_limit = math.inf if isinstance(spec, specs.BoundedArray) else limit
        self.clips_actions = self._action_limit < math.inf
        bounds = (spec.minimum, spec.maximum) if isinstance(spec, specs.BoundedArray) else (-limit, limit)
        low, high = (np.broadcast_to(bound, spec.shape).astype(np.float32) for bound in bounds)
        self.action_space = spaces.Box(low, high, dtype=np.float32)
        if self.has_instructions and not self.instruction:
            raise ValueError(f"the tasks of {record.name} have no sentences: leave out instructions")
        self.varies = bool(self.composer_task.variations.by_name)
        self._physics_info = self.composer_task.scene.info
        self.renderer.check_camera(self.environment)
        rate = 1 / self.environment.control_timestep()
        self.metadata = {**self.metadata, "render_fps": round(rate) if math.isclose(rate, round(rate)) else rate}
        self.observations = self._make_observations(obs_type)
        self.observation_space = self.observations.space
        self.composer_task.hidden_keys = self.observations.hidden
        self._bound_random: np.random.Generator | None = None
        # The generator with which the last episode has started.
        self._drawn_random: np.random.Generator | None = None
        self._episode_step = 0

    def _check_domain(self, domain: Domain) -> None:
        """Raises a ValueError if environments of a domain are of another class, whose arguments are others."""
        if self.default_domain in ("", domain.name):
            return
        other = domain.env_class
        if not (isinstance(self, other) or issubclass(other, type(self))):
            raise ValueError(
                f"domain {domain.name!r} has environments of another class, {other.__name__} in place of "
                f"{type(self).__name__}: leave out domain, and make {domain.env_id!r}"
            )

    def _keep_contents(self, domain: Domain, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Returns arguments without names of files, from which copies are built then as well."""
        found = domain.with_contents(arguments)
        if changed := {name: found[name] for name in found if found[name] is not arguments.get(name)}:
            args, kwargs = self._arguments
            _, *names = inspect.signature(type(self).__init__).parameters
            given = {**dict(zip(names, args, strict=False)), **kwargs}
            self._arguments = (), {**given, **{name: changed[name] for name in given if name in changed}}
        return found

    @classmethod
    def find_obs_type(cls, obs_type: str | None) -> str:
        """Returns the name of an observation type, by default the first; raises a ValueError if it is unknown."""
        return checks.choice(cls.obs_types[0] if obs_type is None else obs_type, cls.obs_types, "obs_type")

    @classmethod
    def check_keywords(cls, domain: Domain, names: Iterable[str], exclude: Collection[str] = ()) -> None:
        """Raises a TypeError unless the environments of a domain have keyword arguments of these names."""
        # TorchRL tries arguments of its own, and drops one if the error is "unexpected keyword argument" and its name.
        choices = domain.arguments(cls).keys() - {"domain", *exclude}
        checks.keywords(names, choices, what="keyword argument", hints=LOAD_ONLY)

    @classmethod
    def default_of(cls, domain: Domain, name: str) -> Any:
        """Returns the default of a keyword argument of the environments of a domain; None if it has none.

        That of settings of images is of images that are observed.
        """
        defaults = {each: argument.default for each, argument in domain.arguments(cls).items()}
        of_images = {"cameras": cls.default_cameras, "image_size": IMAGE_SIZE, "render_quality": "high"}
        return {**defaults, PHYSICS_KEY: domain.physics, "obs_type": cls.obs_types[0], **of_images}.get(name)

    def _make_observations(self, obs_type: str, flat_goals: bool = False) -> Observations:
        observations.observe_by_runner(self.composer_task)
        return Observations(
            self.composer_task,
            obs_type,
            flat_goals=flat_goals,
            dtype=self.observation_dtype,
        )

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": self._arguments,
            "state": self.get_state(),
            "seed": self._np_random_seed,
            "has_drawn": self._drawn_random is not None,
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
        # Pickles of version 1.0 do not say.
        self._drawn_random = self.np_random if state.get("has_drawn", True) else None

    def __repr__(self) -> str:
        settings = f"render_mode={self.render_mode!r}, max_episode_steps={self._max_episode_steps}"
        return f"{type(self).__name__}({self.composer_task!r}, {settings})"

    @property
    def instruction(self) -> str:
        """The task's sentence; the empty string if the task has none. LeRobot reads it by its other two names."""
        return self.composer_task.instruction

    task = task_description = instruction

    @property
    def instructions(self) -> tuple[str, ...]:
        """The task's sentence, then paraphrases of it."""
        return self.composer_task.instructions

    @property
    def variation_space(self) -> spaces.Dict:
        """Ranges of the parameters that vary, by name; empty if nothing varies."""
        ranges = self.composer_task.variations.ranges.items()
        return spaces.Dict({name: spaces.Box(low, high, low.shape, np.float64) for name, (low, high) in ranges})

    @property
    def variation_values(self) -> dict[str, Any]:
        """Values of these parameters in the present episode, in fresh arrays."""
        return self.composer_task.variations.values

    @property
    def variation_split(self) -> str:
        """`seen` or `held_out`."""
        return self.composer_task.variations.split

    @property
    def present_observation(self) -> dict[str, NDArray]:
        """The present observation as the suite's own, which policies expect, whatever the observation type."""
        return self.observations.suite_observation(self._present())

    @property
    def physics_state(self) -> NDArray[np.float64]:
        """The present `qpos`, `qvel` and `act` of the physics, one after the other, in a fresh array."""
        return self.environment.physics.get_state()

    def camera_parameters(self, camera: str, width: int, height: int) -> cameras.CameraParameters:
        """Returns intrinsics and extrinsics of a camera, by its name, for images of `width` x `height` pixels."""
        return cameras.camera_parameters(self.environment.physics, camera, width, height)

    def clip_actions(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns actions `(..., k)` clipped to the `action_limit`."""
        return actions.clip(-self._action_limit, self._action_limit)

    def _get_obs(self, pictures: Mapping[str, np.ndarray]) -> Any:
        """Stores the present flat observation, and pictures by key; returns them in the observation space."""
        self._flat = self.composer_task.flat_observation.astype(self.observation_dtype, copy=False)
        self._pictures = pictures
        return self.observations(self._present())

    def _present(self) -> Present:
        task = self.composer_task
        return Present(self._flat.copy(), task.simulation, task.state, self._pictures)

    def _get_info(self) -> dict[str, Any]:
        """Returns the info of the last step or reset, in fresh lists and arrays, without that of the variation."""
        task = self.composer_task
        return {**task.runner.mdp_info(task.episode), "episode_step": self._number(self._episode_step)}

    def _number(self, value: float) -> Any:
        """Returns a number as infos have it."""
        return np.array(value)

    def _all_infos(self) -> dict[str, Any]:
        """Returns the infos of task, variation and sentence, and physics and control step if not the default."""
        task = self.composer_task
        variation = task.variations.info if self.varies else {}
        timestep = {name: self._number(value) for name, value in self.environment.changed_timestep.items()}
        sentence = {INSTRUCTION: self.instruction} if self.has_instructions else {}
        return {
            **self._get_info(),
            **task.runner.info(task.episode),
            **variation,
            **self._physics_info,
            **timestep,
            **sentence,
        }

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; a bad argument raises a TypeError or ValueError that names it.

        Args:
          seed: seed of the random stream, of any size; when omitted, the stream continues, or with `episode_seeds` that
            of the next seed starts.
          options: `{"state": ...}` continues from a state returned by `get_state`; a seed beside it replaces only the
            random state. `{"variation": names}` has the parameters and groups that vary in this episode, of those of
            `variations`; the others have their defaults. `{"variation_values": {name: value}}` replaces values that
            would be drawn. A task may have options of its own; see its environment. Options that no environment of
            the suite has are ignored.
        """
        if seed is not None:
            seed = checks.integer(seed, "seed", minimum=0)
        names = (STATE, VARIATION, VARIATION_VALUES, *self.composer_task.requests.options)
        chosen = checks.reset_options(options, names, elsewhere=(RESET_MASK,))
        state = chosen.get(STATE)
        if state is None:
            seed = self._next_seed_after(seed)
            reset = self.composer_task.checked_reset(chosen)
            self.check_pictures(chosen)
            self.composer_task.follow(reset)
        elif len(chosen) > 1:
            others = " and ".join((VARIATION, VARIATION_VALUES, *self.composer_task.requests.options))
            raise ValueError(f"a state has its own values: leave out {others}")
        if isinstance(state, Mapping) and state.get("reset_next_step"):
            raise ValueError("the state is of no episode: it was saved before a reset, or after the physics diverged")
        if state is not None:
            observation = self.set_state(state)
        # Not that of gymnasium-robotics' GoalEnv, which refuses observations without goals.
        gymnasium.Env.reset(self, seed=seed)
        self._bind_random_state()
        self._drawn_random = self._bound_random
        if state is None:
            self._episode_step = 0
            observation = self._get_obs(self.environment.reset().observation)
        if self.render_mode == "human":
            self.render()
        return observation, {**self._all_infos(), **self._infos_of_reset(chosen)}

    def check_pictures(self, options: Mapping[str, Any]) -> None:
        """Raises a ValueError if options of a reset ask for pictures that cannot be rendered."""

    def _infos_of_reset(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Returns infos that only a reset with some options has."""
        return {}

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Makes one control step.

        A step after termination continues the episode. A step after a `PhysicsError` starts a new episode instead, with
        reward 0 and whatever the action.

        Raises:
          gymnasium.error.ResetNeeded: after a step that was interrupted, or in which a term of a custom task failed.
          TypeError: the action does not hold real numbers.
          ValueError: the action has the wrong shape, or holds NaN or inf; nothing has changed then.
        """
        if self.clips_actions:
            # NaN and inf must not be clipped away: check first. Without a limit only the task checks.
            action = self.clip_actions(checks.vector(action, self._action_size, "action"))
        if self.environment.resets_next_step:
            gymnasium.Env.reset(self, seed=self._next_seed_after(None))
        self._bind_random_state()
        self._drawn_random = self._bound_random
        timestep = self.environment.step(action)
        self._episode_step = 0 if timestep.first() else self._episode_step + 1
        if timestep.last():
            # The next step continues the episode, as in FrankaKitchen-v1.
            self.environment.continue_episode()
        terminated = timestep.last() and timestep.discount == 0.0
        at_limit = self._max_episode_steps is not None and self._episode_step >= self._max_episode_steps
        if self.render_mode == "human":
            self.render()
        reward = 0.0 if timestep.first() else float(timestep.reward)
        truncated = at_limit or self.composer_task.truncates
        return self._get_obs(timestep.observation), reward, terminated, truncated, self._all_infos()

    def get_state(self) -> dict[str, Any]:
        """Returns the state on which later steps depend, as nested dicts of strings, numbers and arrays."""
        self._bind_random_state()
        return {**self.environment.get_state(), "episode_step": self._episode_step, **self._seeds.saved()}

    def set_state(self, state: Mapping[str, Any]) -> Any:
        """Sets a state returned by `get_state` of this environment, or of another one built with the same arguments.

        Arguments of rendering may differ: a state of an environment without a render mode can be set in one with it.
        Returns the observation; raises as `Environment.set_state`.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict returned by get_state, got {checks.shown(state)}")
        step = checks.integer(state.get("episode_step"), "state['episode_step']", minimum=0)
        own = ("episode_step", *self._seeds.saved())
        next_seed = self._seeds.checked(state)
        self._bind_random_state()
        inner = {key: value for key, value in state.items() if key not in own}
        observation = self._get_obs(self.environment.set_state(inner))
        self._drawn_random = self._bound_random
        self._episode_step = step
        self._seeds.next = next_seed
        if self._seeds:
            self._np_random_seed = self._seeds.current
        return observation

    def render(self) -> np.ndarray | None:
        """Returns an image `(height, width, 3)` uint8, or depth `(height, width)` float32, by `render_mode`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; pass one to the constructor")
            return None
        return self.renderer.render(self.environment, self.render_mode)

    def close(self) -> None:
        """Frees windows and GL contexts; as with the original, steps and resets go on, and a picture makes another."""
        self.renderer.close()
        if self.observations.has_pictures:
            self.environment.physics.free_context()

    def _next_seed_after(self, seed: int | None) -> int | None:
        """Returns the seed with which the next episode starts its stream; None where it draws from the present one.

        Args:
          seed: the one given to `reset`.

        Raises:
          ValueError: with `episode_seeds`, a generator was assigned in place of a seed, and has had its episode.
        """
        has_drawn = self._drawn_random is self.np_random
        return self._seeds.known() if self._seeds and seed is None and has_drawn else seed

    def _bind_random_state(self) -> None:
        """Makes the suite's environment draw from `np_random`, which Gymnasium replaces at each seeding."""
        if self._bound_random is not self.np_random:
            self._bound_random = self.np_random
            self.environment.random_state = np.random.RandomState(self.np_random.bit_generator)
            # Gymnasium's mark of a generator that was assigned is `UNKNOWN` as well.
            self._seeds.next = self._seeds.after(self.np_random_seed)


def suite_env(environment: gymnasium.Env) -> SuiteEnv:
    """Returns the suite's environment within Gymnasium's wrappers."""
    inner = environment.unwrapped
    assert isinstance(inner, SuiteEnv)
    return inner

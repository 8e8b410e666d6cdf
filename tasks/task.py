"""The base of the suite's tasks: steps and resets by the task's MDP, beyond the interface of `composer.Task`."""

import abc
import collections
import dataclasses
import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
import tree
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.assets import Array
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.scenes import Scene, SiteArena
from kitchen_suite.names import ANY_ENVIRONMENT, EnvironmentClasses
from kitchen_suite.tasks.episode import EpisodeState, Sensing, Stepper, sensing_parameters
from kitchen_suite.tasks.extra_observations import ExtraObservations, Measured
from kitchen_suite.tasks.goals import checked_instructions
from kitchen_suite.tasks.mdp import MDP, MEDIAN, ActionMode, PhysicsSimulation, RewardTerm, Termination, as_columns
from kitchen_suite.tasks.observables import ExtraObservables, Pictures, joined
from kitchen_suite.tasks.pushes import PARAMETERS, Pusher
from kitchen_suite.tasks.variations.distributions import ParameterVariation, Variation
from kitchen_suite.tasks.variations.variations import Variations

PICTURE_AXES = 3  # Number of axes of an observed picture: height, width, channels.

# Verdicts, measures, and the control steps at which goals were completed, by the goals' names.
Metrics = dict[str, bool | float | dict[str, int]]

# Hooks of composer's tasks that act in a composer environment alone: the vectorised one steps by the task's MDP. By
# name, what acts in all environments instead.
_INSTEAD = MappingProxyType(
    {
        "get_reward": "add functions of a step to extra_rewards",
        "get_discount": "add functions of a step to extra_terminations",
        "should_terminate_episode": "add functions of a step to extra_terminations",
        "before_step": "give actions another meaning by a control mode, in control_modes",
        "before_substep": "give actions another meaning by a control mode, in control_modes",
        "after_step": "measure what you need by extra_observations",
        "after_substep": "measure what you need by extra_observations, from sensors of the scene",
        "action_spec": "give actions another meaning by a control mode, in control_modes",
        "task_observables": "add observations to extra_observations",
        "observables": "add observations to extra_observations",
        "initialize_episode_mjcf": "change the scene before the task is built, or physics.model in reset_physics",
    }
)
# Longest control step [s]: far above what is of use, and not below one whole image a second in videos and datasets.
MAX_CONTROL_TIMESTEP = 1.0

# Greatest difference of a control step from whole physics steps [physics steps]; that of `composer.Task`.
_WHOLE_STEPS = 1e-6

SUCCESS_RGBA = (0.25, 0.75, 0.3, 1.0)  # Colour of objects that the task counts as a success.


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolicyInputs:
    """The observation of a task as trained policies take it.

    The flat observation is the state, then goals and requests of tasks, without pictures.

    Attributes:
      names: names of trained policies for the task, the most specific one first. The first is equal for tasks that
        differ neither in goals nor in rewards.
      state_size: number of elements of the state.
      goal_size: number of elements of the achieved and the desired goal.
      tasks: names of the tasks that episodes may ask for; empty if the task has no parts.
      observes_requests: whether the observation ends with the request: 1 for each requested one of `tasks`, else 0.
      keys: beginnings of the keys of goals and requests, in the order of the flat observation; all other keys are of
        the state.
      goal_elements: elements of the state that goal states are compared in: the positions of objects; empty where a
        task has no such states.
      goal_place: index in the flat observation of the first of these in the last goal state; None if none is observed.
    """

    names: tuple[str, ...]
    state_size: int
    goal_size: int = 0
    tasks: tuple[str, ...] = ()
    observes_requests: bool = False
    keys: tuple[str, ...] = ()
    goal_elements: tuple[int, ...] = ()
    goal_place: int | None = None

    @property
    def size(self) -> int:
        """Number of elements of the flat observation."""
        return self.state_size + self.goal_size + self.observes_requests * len(self.tasks)

    def with_longer_state(self, count: int) -> "PolicyInputs":
        """Returns the inputs with a number of elements added at the end of the state."""
        place = None if self.goal_place is None else self.goal_place + count
        return dataclasses.replace(self, state_size=self.state_size + count, goal_place=place)

    def flatten(self, observation: NDArray | Mapping[str, Any]) -> NDArray:
        """Returns the flat observation `(..., m)`.

        Args:
          observation: of a dm_env time step, a Gymnasium environment or a recorded episode: `(..., m)`, returned as it
            is; or arrays `(..., k)` by key, with goals as arrays or by task.
        """
        if not isinstance(observation, Mapping):
            return observation
        order = {key: place for place, key in enumerate(self.keys, start=1)}
        keys = sorted(observation, key=lambda key: order.get(key.partition("/")[0], 0))
        arrays: list[NDArray] = []
        for value in (observation[key] for key in keys):
            arrays += value.values() if isinstance(value, Mapping) else [np.atleast_1d(value)]
        return np.concatenate([array for array in arrays if array.ndim < PICTURE_AXES], axis=-1)

    def state_and_requests(self, observation: NDArray | Mapping[str, Any], tasks: Sequence[str]) -> Array:
        """Returns the inputs `(..., n)` of a policy without goals: the state, and 1 for each requested task.

        Args:
          observation: as `flatten` takes it; without requests, it asks for all tasks.
          tasks: names, in the order of the policy.
        """
        flat = self.flatten(observation)
        count, none = len(self.tasks), np.zeros((*flat.shape[:-1], 1))
        requests = flat[..., -count:] if self.observes_requests else np.ones((*flat.shape[:-1], count))
        requested = {name: requests[..., i : i + 1] for i, name in enumerate(self.tasks)}
        return np.concatenate([flat[..., : self.state_size], *(requested.get(name, none) for name in tasks)], axis=-1)

    def wanted(self, observation: NDArray | Mapping[str, Any]) -> Array:
        """Returns the `goal_elements` `(..., g)` of the last goal state in an observation, as `flatten` takes it."""
        assert self.goal_place is not None, "goal states are observed"
        return self.flatten(observation)[..., self.goal_place : self.goal_place + len(self.goal_elements)]


class Completions(NamedTuple):
    """The tasks of an episode that asks for several.

    Attributes:
      tasks: the names of all `n` tasks.
      requested: `(n,)`, which of them the episode asks for.
      steps: `(n,)`, control step, from 1, at which each was first completed; not positive where it was not.
    """

    tasks: tuple[str, ...]
    requested: NDArray[np.bool_]
    steps: NDArray[np.int64]

    @property
    def steps_by_task(self) -> dict[str, int | None]:
        """The requested tasks, each with the control step of its completion or None."""
        rows = zip(self.tasks, self.requested.tolist(), self.steps.tolist(), strict=True)
        return {name: step if step > 0 else None for name, is_requested, step in rows if is_requested}


class ResetRequests:
    """Options of a reset that belong to a task; this class has none.

    Attributes:
      options: names of the options.
      drawn_tasks: names of the `n` tasks of which each episode draws some; empty if every episode asks for the same.
      weights: `(n,)`, with which later episodes draw them; only where tasks are drawn.
    """

    options: tuple[str, ...] = ()
    drawn_tasks: tuple[str, ...] = ()
    weights: Any

    def checked(self, options: Mapping[str, Any]) -> Any:
        """Returns the checked request of a reset's options for one episode; None if they have none.

        Raises a TypeError or a ValueError for an option that the task refuses.
        """
        return None

    def follow(self, request: Any) -> None:
        """Makes the next reset follow a request that `checked` returned."""

    def draw(self, random_state: np.random.RandomState) -> None:
        """Draws what the episode that starts asks for, or discards the draw where a request says so."""

    def recorded(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        """Returns the options of a reset that repeat what was drawn in a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.
        """
        return {}


class SuiteTask(composer.Task):
    """A task that steps by its MDP, with saved states, metrics of its episodes, and optional highlighting of success.

    A custom task that extends a task of the suite overrides class attributes, `__init__`, `reset_physics`,
    `initialize_episode`, `initial_state` and `bind`, which act in dm_env, single and vectorised environments alike, and
    `publish`, for what is displayed. Other hooks of a step are refused: they would act in some environments alone. A
    task that extends this class itself also calls `vary`, and sets `policy_inputs` and `observed`, in its constructor.

    Attributes:
      domain_name: name of the domain whose expert acts in the task; None for a task outside the suite.
      environment_classes: classes of the task's Gymnasium environments, where its domain names none.
      control_modes: the task's control modes by name, the default first; empty if it has only one.
      varied: the parameters that groups vary, in the order in which they are drawn.
      extra_rewards: additional terms of the reward by name, in classes of a user's own: functions of a step; see
        `tasks.mdp.Transition`.
      extra_terminations: additional reasons to terminate an episode by name: functions of a step that return bools.
        Infos have them as `termination/<name>`.
      extra_observations: additional observations by name, in classes of a user's own; a property of a class may return
        them as well. They follow the domain's own in the state.
      instructions: the task in words: its sentence, then paraphrases of it; see `tasks.goals`.
      hidden_keys: keys of observations that policies do not see unless they are privileged, see `policies.registry`:
        those that the `obs_type` of a Gymnasium environment leaves out.
      scene: arena, robot and props.
      robot: the robot that acts.
      mdp: the task's settings, and the mathematics of an episode under them.
      variations: the parameters that vary.
      requests: the options of resets that belong to the task.
      policy_inputs: the observation as trained policies take it.
      observed: the enabled observables of the task by observation key, in order.
      extras: quantities of `extra_observables` that are observed beside the task's own; None if there are none.
      observations: the `extra_observations`.
      extra_observables: the observables of both by observation key.
      extra_slices: slice of each among their elements, which are the last ones of the state; of `extra_observations`
        from the compilation on.
      extra_size: number of their elements, as long.
      pictures: the pictures of cameras that are observed.
      pusher: makes the pushes of episodes; from the compilation on.
      random: the random state that the environment last passed to the task.
      episode: state of the present episode; arrays without leading axes, not to be written to.
      truncates: whether the last step truncated the episode, whatever the environment's time limit.
      default_control_timestep: length of a control step [s] that another one replaces; None where none does.
    """

    domain_name: str | None = None
    environment_classes: ClassVar[EnvironmentClasses] = ANY_ENVIRONMENT
    control_modes: ClassVar[Mapping[str, Callable[..., ActionMode]]] = MappingProxyType({})
    varied: ClassVar[Sequence[ParameterVariation]] = ()
    extra_rewards: ClassVar[Mapping[str, RewardTerm]] = MappingProxyType({})
    extra_terminations: ClassVar[Mapping[str, Termination]] = MappingProxyType({})
    # A class may have a property instead.
    extra_observations: Any = MappingProxyType({})
    # A class may have a property instead.
    instructions: Any = ()
    hidden_keys: Collection[str] = frozenset()

    # Of the domain's own classes, which its task names.
    mdp: Any
    requests: Any

    variations: Variations
    policy_inputs: PolicyInputs
    pusher: Pusher
    random: np.random.RandomState
    default_control_timestep: float | None = None

    def __init_subclass__(cls, **arguments: Any) -> None:
        """Raises a TypeError if a class overrides a hook that would act in some environments alone."""
        super().__init_subclass__(**arguments)
        for name, instead in _INSTEAD.items():
            if inspect.getattr_static(cls, name) is not inspect.getattr_static(SuiteTask, name):
                raise TypeError(
                    f"{cls.__name__} must not override {name}, which vectorised environments do not call: {instead}; "
                    "see docs/guide/extending.md"
                )

    def __init__(
        self,
        scene: Scene,
        mdp: MDP,
        /,
        *,
        extra_observables: Sequence[str] = (),
        variations: str | Sequence[str] | Mapping[str, Variation] | None = None,
        variation_split: str = "seen",
        **pictures: Any,
    ) -> None:
        """Sets up what all tasks have.

        Args:
          scene: of the task; not yet compiled.
          mdp: the task's settings and mathematics.
          extra_observables: further quantities to observe, by the names of `observables.offered`.
          variations: groups of parameters that vary, or distributions by parameter; see `Variations`.
          variation_split: which distributions of the groups are drawn from, `seen` or `held_out`.
          **pictures: `cameras`, `image_size`, `depth` and `segmentation`; see `Pictures`.
        """
        extras = ExtraObservables(scene, extra_observables)
        self.extras = extras if extras.size else None
        self.observations = ExtraObservations(self.extra_observations, type(self).__name__)
        own = self.observations.observables(self._measured)
        self.extra_observables: dict[str, observable.Observable] = joined(extras.by_name, own)
        self.extra_slices = dict(extras.slices)
        self.extra_size = extras.size
        self.pictures = Pictures(scene.arena.mjcf_model, **pictures)
        self.observed: Mapping[str, observable.Observable] = {}
        self.scene = scene
        self.robot = scene.robot
        self.mdp = mdp
        self._requested_variations = variations, variation_split
        self.requests = ResetRequests()
        self.episode = EpisodeState()
        self.truncates = False
        self._terminates = False
        self._visualize_reward = False
        for name, termination in self.extra_terminations.items():
            if not callable(termination):
                raise TypeError(f"extra_terminations[{name!r}] must be a function, got {checks.shown(termination)}")

    @classmethod
    def with_extra_rewards(cls, rewards: Mapping[str, RewardTerm]) -> dict[str, RewardTerm]:
        """Returns the terms of a reward and the `extra_rewards`; a ValueError where both have a term of one name."""
        if taken := sorted(rewards.keys() & cls.extra_rewards.keys()):
            raise ValueError(f"extra_rewards of {cls.__name__} must have other names than the reward's terms: {taken}")
        return {**rewards, **cls.extra_rewards}

    def vary(self, *, handles: Sequence[mjcf.Element], parameters: Sequence[Parameter] = (), **arguments: Any) -> None:
        """Selects the parameters that vary; to be called once, before the scene is compiled.

        Args:
          handles: sites that the hand must reach in every layout.
          parameters: those of the task, beside the parameters of sensing and of pushes.
          **arguments: further ones of `Variations`.
        """
        own = (*sensing_parameters(self.mdp.noise_parts), *PARAMETERS, *parameters)
        self.variations = Variations(
            self.scene, self.varied, *self._requested_variations, handles=handles, parameters=own, **arguments
        )

    def use_control_timestep(self, timestep: float) -> None:
        """Replaces the length of a control step [s]; to be called once, before an environment is built.

        Targets of velocities and speeds follow. Numbers of control steps, such as `max_task_steps`, stay.

        Raises:
          TypeError: it is no number.
          ValueError: it is not positive, longer than 1 s, or no whole number of physics steps.
        """
        checks.number(timestep, "control_timestep", positive=True, maximum=MAX_CONTROL_TIMESTEP)
        steps = timestep / self.physics_timestep
        whole = max(1, round(steps))
        if abs(steps - whole) > _WHOLE_STEPS:
            raise ValueError(
                f"control_timestep must be a whole number of physics steps of {self.physics_timestep:g} s, got "
                f"{timestep!r}; the nearest one is {whole * self.physics_timestep!r}"
            )
        if whole != self.physics_steps_per_control_step:
            self.default_control_timestep = self.control_timestep
            self.set_timesteps(control_timestep=float(timestep), physics_timestep=self.physics_timestep)

    @property
    def root_entity(self) -> SiteArena:
        return self.scene.arena

    @property
    def task_observables(self) -> collections.OrderedDict[str, observable.Observable]:
        return collections.OrderedDict(self.observed)

    @property
    def observables(self) -> collections.OrderedDict[str, observable.Observable]:
        """All observables: those of the task, of its entities, and the pictures."""
        return collections.OrderedDict({**super().observables, **self.pictures.by_name})

    @property
    def visualize_reward(self) -> bool:
        """Whether objects change their colour while the task rewards their position."""
        return self._visualize_reward

    @visualize_reward.setter
    def visualize_reward(self, value: bool) -> None:
        self._visualize_reward = checks.boolean(value, "visualize_reward")

    @property
    def instruction(self) -> str:
        """The task's sentence, such as `open the microwave door`; the empty string if it has none."""
        return next(iter(checked_instructions(self.instructions, type(self).__name__)), "")

    def draw_instruction(self, generator: np.random.Generator) -> str:
        """Returns one of the `instructions`, each with the same probability; a ValueError if there are none.

        Args:
          generator: that is drawn from; the environment's random stream is not.
        """
        if not isinstance(generator, np.random.Generator):
            raise TypeError(f"generator must be a numpy.random.Generator, got {checks.shown(generator)}")
        if not (instructions := checked_instructions(self.instructions, type(self).__name__)):
            raise ValueError("there are no instructions to draw from: the task has no sentence")
        return instructions[generator.integers(len(instructions))]

    @property
    def state(self) -> Any:
        """The MDP's state of the present episode; arrays without leading axes, not to be written to."""
        return self.episode.mdp_state

    @property
    def reward_terms(self) -> dict[str, float]:
        """The terms of the last step's reward by name; zeros before the first step of an episode."""
        return {name: float(term) for name, term in self.state.terms.items()}

    @abc.abstractmethod
    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns the metrics of an episode.

        Args:
          infos: its last infos, of the Gymnasium environment or from a recording; arrays without leading axis.
        """

    @abc.abstractmethod
    def progress_in(self, infos: Mapping[str, Any]) -> NDArray:
        """Returns how far episodes have come, `(...)`, from their infos: a number that grows towards success."""

    def completions_in(self, infos: Mapping[str, Any]) -> Completions | None:
        """Returns which tasks an episode asks for and has completed, from infos without leading axis.

        None if the task does not consist of tasks that can be counted.
        """
        return None

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        """Names of the task's goals, and whether each is reached after each step of a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.

        Returns:
          `n` names and a mask `(T + 1, n)`; None if the arrays do not determine it.
        """
        return None

    @property
    def episode_metrics(self) -> Metrics:
        """Metrics of the present episode up to the last control step; see `metrics`."""
        return self.metrics(self.mdp.info(self.state))

    @property
    def episode_completions(self) -> Completions | None:
        """Tasks that the present episode asks for and has completed; None if they cannot be counted."""
        return self.completions_in(self.mdp.info(self.state))

    def reset_statistics(self) -> None:
        """Resets all memory of earlier episodes, so that a run does not depend on earlier ones."""
        zeros = {name: np.zeros_like(getattr(self.state, name)) for name in self.mdp.persistent}
        self.episode = self.episode._replace(mdp_state=self.state._replace(**zeros))

    def restore(self, physics: mjcf.Physics, observation: Array) -> None:
        """Moves robot and objects to the positions and velocities of a recorded observation.

        The caller updates what MuJoCo derives from these, as `Environment.set_state` does. Raises a ValueError if the
        task's episodes start from a seed only.
        """
        raise ValueError(f"an episode of {type(self).__name__} can be repeated only from its seed, which is missing")

    def set_observed_positions(self, observation: Array) -> None:
        """Makes the next action start from the robot's positions in a recorded observation; raises as `restore`."""
        raise ValueError(f"an episode of {type(self).__name__} can be repeated only from its seed, which is missing")

    def is_initial(self, physics: mjcf.Physics, observation: Array) -> bool:
        """Whether a recorded observation is one of the present physics state, up to noise and rounding."""
        return True

    def get_state(self) -> dict[str, Any]:
        """Returns the task's state beside the physics: nested dicts of strings and fresh arrays."""
        return {**self.saved_state(), **self.episode.memory(), **self.variations.info}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Sets a state that `get_state` returned.

        Raises a TypeError or a ValueError, with nothing changed, if it is damaged or of another task.
        """
        state = checks.matching(state, self.get_state(), "task state")
        values = self.variations.randomizer.checked(state.get("variation_values", {}))
        self.restore_state(state)
        self.variations.restore(values, int(state.get("layout_refusals", 0)))
        self.episode = self.episode.with_memory(state)._replace(variation=self.variations.info)

    def saved_state(self) -> dict[str, Any]:
        """Returns what `get_state` returns of the MDP's state, and what else the task keeps."""
        return tree.map_structure(np.array, self.state._asdict())

    def restore_state(self, state: Mapping[str, Any]) -> None:
        """Sets what `saved_state` returned; raises a ValueError, with nothing changed, where it does not fit."""
        self.set_mdp_state(type(self.state)(**{name: state[name] for name in self.state._fields}))

    @abc.abstractmethod
    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Moves robot and objects to the start of an episode, before variations are drawn."""

    def initial_state(self, draws: Array) -> Any:
        """Returns the MDP's state before the first step; `draws` as in `MDP.initial_state`."""
        return self.mdp.initial_state(self.mdp.sensors.read(self._simulation), draws)

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up what the task needs beside the MDP in a compiled scene."""

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates observables and, given a physics, colours after a change of state."""

    def action_spec(self, physics: mjcf.Physics) -> specs.Array:
        return self.mdp.action_mode.spec(self.robot)

    def after_compile(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self.random = random_state
        mdp, self._simulation = self.mdp, PhysicsSimulation(physics)
        self.pusher = Pusher.make(physics, self.scene, mdp)
        self._stepper = Stepper(mdp, self._simulation, self.pusher, self.observations, self.extra_terminations)
        mdp.sensors.bind(physics)
        mdp.action_mode.bind(physics, self.robot, self.control_timestep)
        self.variations.bind(physics)
        self._joint_columns = as_columns(physics.bind(self.robot.joints).qposadr)
        if self.extras is not None:
            self.extras.bind(physics)
        (self._action_size,) = self.action_spec(physics).shape
        self.bind(physics)
        self._start(physics, np.zeros(mdp.noise_draws))
        self._append_observations()

    def _measured(self) -> Measured:
        assert self.episode.measured is not None, "the scene is compiled"
        return self.episode.measured

    def _append_observations(self) -> None:
        """Adds the elements of the extra observations to the state, once their number is known."""
        if self.episode.measured is None:
            return
        own = {name: self.observations.shown(self.episode.measured, name) for name in self.observations.enabled}
        if not own.keys() - self.extra_slices.keys():
            return
        before = self.extra_size
        for name, value in own.items():
            self.extra_slices[name] = slice(self.extra_size, self.extra_size + value.size)
            self.extra_size += value.size
        self.policy_inputs = self.policy_inputs.with_longer_state(self.extra_size - before)

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self.random = random_state
        self.requests.draw(random_state)
        self.reset_physics(physics, random_state)
        self.variations.draw(physics, random_state)
        self._start(physics, self.mdp.draw_noise(random_state))
        self._draw_noise_of_observations(random_state)

    def _draw_noise_of_observations(self, random_state: np.random.RandomState) -> None:
        """Draws the noise of the extra observations."""
        measured = self.episode.measured
        if measured is not None:
            noisy = self.observations.corrupt(measured.values, random_state)
            self.episode = self.episode._replace(measured=measured._replace(noisy=noisy))

    def checked_action(self, action: ArrayLike) -> Array:
        """Returns an action as a fresh float64 array.

        Raises:
          TypeError: the action does not hold real numbers.
          ValueError: the action has another shape than its spec, holds NaN or inf, or has no meaning.
        """
        checked = checks.vector(action, self._action_size, "action").copy()
        self.mdp.action_mode.check(checked)
        return checked

    def before_step(self, physics: mjcf.Physics, action: ArrayLike, random_state: np.random.RandomState) -> None:
        """Sets the actuators' targets for the whole control step; raises as `checked_action`."""
        self.random, mode = random_state, self.mdp.action_mode
        checked = self.checked_action(action)
        if mode.reads_derived and not physics.legacy_step:
            mujoco.mj_step1(physics.model.ptr, physics.data.ptr)
        draw = random_state.random_sample() if mode.draws else MEDIAN
        self._acting = self._stepper.act(self.episode, checked, draw)
        self._simulation.write("ctrl", self.mdp.sensors.ctrl, self._acting.ctrl)

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self.random, mdp = random_state, self.mdp
        if not physics.legacy_step:
            # MuJoCo's own step leaves kinematics and sensors as they were before it.
            mdp.sensors.refresh(physics)
            if self.extras is not None:
                self.extras.refresh(physics)
            if self.observations.by_name:
                self._simulation.evaluate()
        reading = mdp.sensors.read(self._simulation)
        draws = mdp.draw_noise(random_state)
        self._set_episode(self._stepper.observe(self.episode, self._acting, reading, draws), physics)
        if self.observations.by_name:
            self._draw_noise_of_observations(random_state)

    def get_reward(self, physics: mjcf.Physics) -> float:
        return float(self.mdp.reward(self.state))

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        return self._terminates or self.truncates

    def get_discount(self, physics: mjcf.Physics) -> float:
        return 0.0 if self._terminates else 1.0

    def _start(self, physics: mjcf.Physics, draws: Array) -> None:
        """Sets the state before the first step; `draws` as in `MDP.initial_state`."""
        mdp, before = self.mdp, self.episode.mdp_state
        mdp.sensors.refresh(physics)
        positions = np.array(self._simulation.read("qpos", self._joint_columns))
        values = self.variations.randomizer.values
        start = EpisodeState(
            sensing=Sensing.start(values, mdp, self.robot.holding_targets(positions)),
            push=self.pusher.start(values, self._simulation),
            variation=self.variations.info,
        )
        state = self.initial_state(start.scaled(draws))
        episode = start._replace(mdp_state=state, terminations=dict.fromkeys(self.extra_terminations, np.array(False)))
        if self.observations.by_name:
            self._simulation.evaluate()
            values = self.observations.measure(self._simulation, state, ())
            episode = episode._replace(measured=Measured(values, self.observations.uncorrupted(values)))
        self._set_episode(episode if before is None else episode.persisting(mdp.persistent, before, True), physics)
        self._start_command(physics)

    def _start_command(self, physics: mjcf.Physics) -> None:
        """Makes the control mode start from the present state of the physics."""
        if self.mdp.action_mode.reads_derived:
            mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        self.episode = self.episode._replace(command=self.mdp.action_mode.start(self._simulation))

    def set_mdp_state(self, state: Any, physics: mjcf.Physics | None = None) -> None:
        """Sets the MDP's state, and publishes it."""
        self._set_episode(self.episode._replace(mdp_state=state), physics)

    def _set_episode(self, episode: EpisodeState, physics: mjcf.Physics | None) -> None:
        """Sets the state of the episode, and publishes it."""
        self.episode, state = episode, episode.mdp_state
        # composer asks twice.
        self._terminates = bool(self._stepper.terminates(episode))
        self.truncates = bool(self.mdp.truncates(state))
        self.publish(physics)


class OpeningTask(SuiteTask):
    """A task that opens a drawer or a door.

    Attributes:
      opened: `drawer`, whose opening is in m, or `door`, whose opening is a share of the goal; infos have it as
        `drawer_opening` or `door_opening`.
    """

    opened: ClassVar[str]

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether the drawer or door is open, whether it was at any time, and how far it is open."""
        return {
            "success": bool(infos["is_success"]),
            "success_at_any_time": bool(infos["success_at_any_time"]),
            f"{self.opened}_opening": float(self.progress_in(infos)),
        }

    def progress_in(self, infos: Mapping[str, Any]) -> Array:
        """Returns how far the drawer or door is open [m, or as a share]."""
        return infos[f"{self.opened}_opening"]

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        key = "info/is_success"
        return ((self.opened,), arrays[key][:, np.newaxis]) if key in arrays else None


class Highlighting:
    """Colours of some objects: their own, or green where the task counts them as a success."""

    def __init__(self, physics: mjcf.Physics, objects: Iterable[Sequence[mjcf.Element]]) -> None:
        """Stores the objects, each with its geoms, and their own colours."""
        self._physics, self._objects = physics, [*objects]
        self._own_rgba = [np.array(physics.bind(geoms).rgba) for geoms in self._objects]

    def update(self, successes: Iterable[bool]) -> None:
        """Colours the objects that are a success green, and restores the own colours of the others."""
        for geoms, own_rgba, is_success in zip(self._objects, self._own_rgba, successes, strict=True):
            self._physics.bind(geoms).rgba = SUCCESS_RGBA if is_success else own_rgba

"""The base of the suite's tasks: steps and resets by the task's MDP, beyond the interface of `composer.Task`."""

import abc
import collections
import dataclasses
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import mujoco
import numpy as np
import tree
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks, signatures
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.scenes import Scene, SiteArena
from kitchen_suite.environment_classes import ANY_ENVIRONMENT, EnvironmentClasses
from kitchen_suite.tasks.control_modes.action_mode import ActionMode
from kitchen_suite.tasks.episode.carried_objects import CarriedObjects
from kitchen_suite.tasks.episode.draws import NoDraws, SingleDraws
from kitchen_suite.tasks.episode.extra_observables import NamedQuantities
from kitchen_suite.tasks.episode.extra_observations import ExtraObservations, Measured
from kitchen_suite.tasks.episode.extra_successes import ExtraSuccesses
from kitchen_suite.tasks.episode.extra_terminations import ExtraTerminations
from kitchen_suite.tasks.episode.lasting_success import LastingSuccess
from kitchen_suite.tasks.episode.noise_and_delay import NoiseAndDelay
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.episode.pushes import Pushes
from kitchen_suite.tasks.episode.quality import QualityMeter
from kitchen_suite.tasks.episode.runner import EpisodeRunner
from kitchen_suite.tasks.episode.state import EpisodeState
from kitchen_suite.tasks.goals import checked_instructions
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.metrics import Completions, Metrics, Records
from kitchen_suite.tasks.observables import Computed, joined
from kitchen_suite.tasks.pictures import GOAL_PIXELS, Pictures
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.tasks.requests import VARIATION, VARIATION_VALUES, Requests, Reset
from kitchen_suite.tasks.settings import Settings
from kitchen_suite.tasks.simulation import PhysicsSimulation
from kitchen_suite.tasks.terms import (
    Condition,
    Observation,
    RewardTerm,
    Termination,
    Transition,
    added,
    added_functions,
    check_recordable,
    end_to_end,
    in_shape,
)
from kitchen_suite.tasks.variations.distributions import ParameterVariation, Variation
from kitchen_suite.tasks.variations.variations import Variations
from kitchen_suite.types import Array

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


class SuiteTask(composer.Task):
    """A task that steps by its MDP, with saved states, metrics of its episodes, and optional highlighting of success.

    A custom task that extends a task of the suite overrides class attributes, `__init__`, `reset_physics`,
    `initialize_episode`, `initial_state` and `bind`, which act in dm_env, single and vectorised environments alike, and
    `publish`, for what is displayed. Other hooks of a step are refused: they would act in some environments alone. A
    task that extends this class itself also sets `default_control_timestep`, and calls `vary` in its constructor.

    Attributes:
      default_control_timestep: length of a control step [s] where no other is asked for.
      domain_name: name of the domain whose expert acts in the task; None for a task outside the suite.
      environment_classes: classes of the task's Gymnasium environments, where its domain names none.
      control_modes: the task's control modes by name, the default first; empty if it has only one.
      varied: the parameters that groups vary, in the order in which they are drawn.
      extra_rewards: additional terms of the reward by name, in classes of a user's own: functions of a step; see
        `tasks.terms.Transition`. Of these four, a class adds to those of the classes that it extends, replaces one of
        these under its name, and removes one by None. A property of a class may return them as well.
      extra_terminations: additional reasons to terminate an episode by name: functions of a step that return bools.
        Infos have them as `termination/<name>`.
      extra_successes: conditions of a success of the class's own by name: functions of a step that return bools. Where
        there are some, an episode succeeds at the first control step after which all of them are true, whatever the
        tasks of the domain; it does not end by that. Infos have them as `success/<name>`.
      extra_observations: additional observations by name. They follow the domain's own in the state.
      instructions: the task in words: its sentence, then paraphrases of it; see `tasks.goals`.
      hidden_keys: keys of observations that policies do not see unless they are privileged, see `policies.registry`:
        those that the `obs_type` of a Gymnasium environment leaves out.
      scene: arena, robot and props.
      robot: the robot that acts.
      mdp: the task's settings, and the mathematics of an episode under them.
      variations: the parameters that vary.
      requests: the options of resets that belong to the task.
      records: reads metrics and completions from infos and recordings of the task.
      policy_inputs: the observation as trained policies take it; from the compilation on.
      observed: the enabled observables of the task by observation key, in order.
      quantities: those of `extra_observables` that are observed beside the task's own.
      observations: the `extra_observations` of the class and of those that it extends.
      terminations: their `extra_terminations`.
      successes: their `extra_successes`.
      extra_observables: the observables of both by observation key.
      extra_slices: slice of each among their elements, which are the last ones of the state; from the compilation on.
      extra_size: number of their elements; from the compilation on.
      flat_slices: slice of each observation in `flat_observation`, in order; from the compilation on.
      pictures: the pictures of cameras that are observed.
      meter: measures the quality of episodes; None unless `configure` was asked for it.
      parts: the optional parts of the task's episodes by name, in their order; from the compilation on.
      runner: runs the episodes; from the compilation on.
      simulation: access to the fields of the physics; from the compilation on.
      random: the random state that the environment last passed to the task.
      episode: state of the present episode; arrays without leading axes, not to be written to.
      truncates: whether the last step truncated the episode, whatever the environment's time limit.
      has_begun_step: whether the action of the last `before_step` was accepted, after which a step changes the episode.
    """

    default_control_timestep: ClassVar[float]
    domain_name: str | None = None
    environment_classes: ClassVar[EnvironmentClasses] = ANY_ENVIRONMENT
    control_modes: ClassVar[Mapping[str, Callable[..., ActionMode]]] = MappingProxyType({})
    varied: ClassVar[Sequence[ParameterVariation]] = ()
    # A class may have properties instead of these.
    extra_rewards: Any = MappingProxyType({})
    extra_terminations: Any = MappingProxyType({})
    extra_successes: Any = MappingProxyType({})
    extra_observations: Any = MappingProxyType({})
    instructions: Any = ()
    hidden_keys: Collection[str] = frozenset()

    # Of the domain's own classes, which its task names.
    mdp: Any
    requests: Any

    variations: Variations
    policy_inputs: PolicyInputs
    parts: Mapping[str, EpisodePart]
    runner: EpisodeRunner
    simulation: PhysicsSimulation
    random: np.random.RandomState
    extra_slices: Mapping[str, slice]
    extra_size: int
    flat_slices: Mapping[str, slice]
    meter: QualityMeter | None = None

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
          extra_observables: names of additional quantities to observe; see docs/guide/observations.md.
          variations: groups of parameters that vary, or distributions by parameter; see docs/guide/variations.md.
          variation_split: which distributions of the groups are drawn from, `seen` or `held_out`.
          **pictures: `cameras`, `image_size`, `depth` and `segmentation`; see `Pictures`.
        """
        self.quantities = NamedQuantities(scene, extra_observables)
        self.observations = ExtraObservations(added(self, "extra_observations"), type(self).__name__)
        self.terminations: dict[str, Termination] = self._added_terms("extra_terminations", bool)
        self.successes: dict[str, Condition] = self._added_terms("extra_successes", bool)
        own = self.observations.observables(self._measured)
        self.extra_observables: dict[str, observable.Observable] = joined(self.quantities.by_name, own)
        self.pictures = Pictures(scene.arena.mjcf_model, **pictures)
        self.scene = scene
        self.robot = scene.robot
        self.mdp = mdp
        if extra_rewards := self._added_terms("extra_rewards", np.float64):
            self.mdp = dataclasses.replace(mdp, rewards=self._joined_rewards(mdp.rewards, extra_rewards))
        check_recordable(self.mdp.rewards, f"reward and extra_rewards of {type(self).__name__}")
        check_recordable(self.terminations, f"extra_terminations of {type(self).__name__}")
        check_recordable(self.successes, f"extra_successes of {type(self).__name__}")
        # In the order in which they act in a control step.
        self._offered_parts: list[EpisodePart] = [
            NoiseAndDelay(self.mdp, scene.robot),
            Pushes(scene, self.mdp),
            *([self.quantities] if self.quantities.size else []),
            *([self.observations] if self.observations.by_name else []),
            *([ExtraTerminations(self.terminations)] if self.terminations else []),
            *([ExtraSuccesses(self.successes)] if self.successes else []),
        ]
        self.observed = self._make_observables()
        self._requested_variations = variations, variation_split
        self.requests = Requests()
        self.records = Records(self) if self.successes else self.make_records()
        self._reset = Reset()
        self.episode = EpisodeState()
        self.truncates = False
        self.has_begun_step = False
        self._terminates = False
        self._visualize_reward = False
        scene.hold_free_objects()
        self.set_timesteps(control_timestep=self.default_control_timestep, physics_timestep=scene.physics_timestep)

    def _added_terms(self, attribute: str, dtype: type) -> dict[str, Callable[[Transition], NDArray[Any]]]:
        """Returns the terms of an attribute by name: functions that return arrays `(...)` of a dtype."""
        return in_shape(added_functions(self, attribute), attribute, dtype)

    @classmethod
    def _joined_rewards(
        cls, rewards: Mapping[str, RewardTerm], extra: Mapping[str, RewardTerm]
    ) -> dict[str, RewardTerm]:
        """Returns the terms of a reward and the `extra_rewards`; a ValueError where both have a term of one name."""
        if taken := sorted(rewards.keys() & extra.keys()):
            raise ValueError(f"extra_rewards of {cls.__name__} must have other names than the reward's terms: {taken}")
        return {**rewards, **extra}

    def _make_observables(self) -> dict[str, observable.Observable]:
        """Returns an enabled observable for each observation, by key, in order.

        Raises a ValueError where two observations have one key, or one has that of an entity's observable or of a
        picture, which composer would observe in its place.
        """
        entities = {
            key: own for entity in self.root_entity.iter_entities() for key, own in entity.observables.as_dict().items()
        }
        state: dict[str, observable.Observable] = {}
        for key, term in self.mdp.observations.items():
            if term.noise is not None or not term.enabled:
                raise ValueError(
                    f"observations[{key!r}] of {type(self.mdp).__name__} must be enabled and without a corruptor: its "
                    "noise is that of MDP.corrupted; extra_observations of a task may have either"
                )
            state[key] = entities[key] if key in entities else self._observable(term)
            if key in self.mdp.noisy_observations:
                state[key].corruptor = self._noise(key)
        goals = {
            f"{key}/{name}": self._goal_observable(term, part)
            for key, term in self.mdp.goal_observations.items()
            for name, part in self.mdp.goals.slices.items()
        }
        requests = {key: self._observable(term) for key, term in self.mdp.request_observations.items()}
        if self.mdp.has_goal_pictures:
            for place, picture in enumerate(self.pictures.colour):
                requests[f"{GOAL_PIXELS}/{picture.camera}"] = self._goal_picture(place)
        observed = joined(state, self.extra_observables, goals, requests)
        others = {**entities, **self.pictures.by_name}
        if taken := sorted(key for key, own in observed.items() if others.get(key, own) is not own):
            raise ValueError(
                "extra_observations must have other names than the observables of entities, enabled or not, and than "
                f"pictures: {taken}"
            )
        for part in observed.values():
            part.enabled = True
        return observed

    def _observable(self, term: Observation) -> observable.Observable:
        """Returns an observable of a term of the MDP."""
        read = term.read
        # Read in every step: a property would take as long again.
        return Computed(lambda: read(self.simulation, self.episode.mdp_state))

    def _goal_observable(self, term: Observation, part: slice) -> observable.Observable:
        """Returns an observable of the elements of one goal in a term of the MDP."""
        read = term.read
        return Computed(lambda: read(self.simulation, self.episode.mdp_state)[part])  # type: ignore[index]

    def _goal_picture(self, place: int) -> observable.Observable:
        """Returns an observable of the picture of the goal by one of the cameras."""
        return Computed(lambda: self.mdp.goal_pictures(self.state)[place])

    def _noise(self, key: str) -> Callable[..., ArrayLike]:
        """Returns a corruptor that adds the noise that the state holds to one of the MDP's observations."""
        corrupted = self.mdp.corrupted
        return lambda clean, random_state=None: corrupted(key, clean, self.episode.mdp_state)

    def vary(self, *, handles: Sequence[mjcf.Element], parameters: Sequence[Parameter] = (), **arguments: Any) -> None:
        """Selects the parameters that vary; to be called once, before the scene is compiled.

        Args:
          handles: sites that the hand must reach in every layout.
          parameters: those of the task, beside the parameters of sensing and of pushes.
          **arguments: further ones of `Variations`.
        """
        own = (*(each for part in self._offered_parts for each in part.parameters), *parameters)
        self.variations = Variations(
            self.scene, self.varied, *self._requested_variations, handles=handles, parameters=own, **arguments
        )

    def configure(self, settings: Settings) -> None:
        """Takes the length of a control step, and whether quality is measured, before an environment is built.

        To be called once, after all entities have been attached. Targets of velocities and speeds follow the length.
        Numbers of control steps, such as `max_task_steps`, stay.

        Raises:
          TypeError: the length is no number.
          ValueError: it is not positive, longer than 1 s, or no whole number of physics steps.
        """
        if settings.control_timestep is not None:
            self._use_control_timestep(settings.control_timestep)
        if settings.quality:
            physics_steps = self.physics_steps_per_control_step
            self.meter = QualityMeter(self.scene, self.mdp, physics_steps)
            own = next((part for part in self._offered_parts if isinstance(part, ExtraSuccesses)), None)
            measuring = [self.meter, LastingSuccess(self.mdp, own)]
            if carried := self.mdp.carried_joints(self.scene):
                measuring.append(CarriedObjects(self.scene, carried, physics_steps))
            self._offered_parts += measuring

    def _use_control_timestep(self, timestep: float) -> None:
        """Replaces the length of a control step [s]; raises as `configure`."""
        checks.number(timestep, "control_timestep", positive=True, maximum=MAX_CONTROL_TIMESTEP)
        steps = timestep / self.physics_timestep
        whole = max(1, round(steps))
        if abs(steps - whole) > _WHOLE_STEPS:
            raise ValueError(
                f"control_timestep must be a whole number of physics steps of {self.physics_timestep:g} s, got "
                f"{timestep!r}; the nearest one is {whole * self.physics_timestep!r}"
            )
        if whole != self.physics_steps_per_control_step:
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
    def flat_observation(self) -> Array:
        """The present observation of Gymnasium's environments without goals and pictures, `(m,)`, in a fresh array."""
        return self.runner.observation(self.episode)

    @property
    def reward_terms(self) -> dict[str, float]:
        """The terms of the last step's reward by name; zeros before the first step of an episode."""
        return {name: float(term) for name, term in self.state.terms.items()}

    def checked_reset(self, options: Mapping[str, Any]) -> Reset:
        """Returns what the options of a reset ask for, so that `follow` makes the next reset follow it.

        Args:
          options: `variation`, `variation_values`, and those of the task's `requests`; see the Gymnasium environments.
            Others are ignored.

        Raises:
          TypeError: an option of the wrong type.
          ValueError: an option that the task refuses.
        """
        variation = self.variations.request(options.get(VARIATION), options.get(VARIATION_VALUES))
        return Reset(variation, self.requests.checked(options))

    def follow(self, reset: Reset) -> None:
        """Makes the next reset, and no later one, follow what `checked_reset` returned."""
        self._reset = reset

    @property
    def episode_metrics(self) -> Metrics:
        """Metrics of the present episode up to the last control step; see `records`."""
        return self.records.metrics(self.runner.mdp_info(self.episode))

    @property
    def quality(self) -> dict[str, float]:
        """The quality of the present episode by name, as infos have it; empty if it is not measured."""
        if self.meter is None:
            return {}
        measuring = (self.meter.name, LastingSuccess.name, CarriedObjects.name)
        infos = [self.parts[name].info(self.episode.parts[name]) for name in measuring if name in self.parts]
        return {name: value.item() for info in infos for name, value in info.items()}

    @property
    def disturbed_objects(self) -> list[str]:
        """Joints of the objects that the present episode has disturbed; empty if its quality is not measured."""
        if self.meter is None:
            return []
        disturbed = self.episode.parts[self.meter.name].disturbed.tolist()
        return [name for name, is_disturbed in zip(self.meter.objects, disturbed, strict=True) if is_disturbed]

    @property
    def episode_completions(self) -> Completions | None:
        """Tasks that the present episode asks for and has completed; None if they cannot be counted."""
        return self.records.completions(self.runner.mdp_info(self.episode))

    def reset_statistics(self) -> None:
        """Resets all memory of earlier episodes, so that a run does not depend on earlier ones."""
        zeros = {name: np.zeros_like(getattr(self.state, name)) for name in self.mdp.persistent}
        self.episode = self.episode._replace(mdp_state=self.state._replace(**zeros))

    def get_state(self) -> dict[str, Any]:
        """Returns the task's state beside the physics: nested dicts of strings and fresh arrays."""
        return {**self.saved_state(), **self.runner.saved(self.episode), **self.variations.info}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Sets a state that `get_state` returned.

        Raises a TypeError or a ValueError, with nothing changed, if it is damaged or of another task.
        """
        state = checks.matching(state, self.get_state(), "task state")
        values = self.variations.randomizer.checked(state.get("variation_values", {}))
        self.restore_state(state)
        self.variations.restore(values, int(state.get("layout_refusals", 0)))
        self.episode = self.runner.restored(self.episode, state)._replace(variation=self.variations.info)

    def state_definition(self) -> dict[str, Any]:
        """Returns what the task was built with, by name of the argument; states of tasks with others do not fit.

        A task adds its own to those of its base. Arguments that `Domain.load` was given need not be among them, unless
        they can be written in several ways.
        """
        mode = self.mdp.action_mode
        # A user's mode need not keep its arguments.
        settings = {name: getattr(mode, name) for name in signatures.names(type(mode)) if hasattr(mode, name)}
        return {"control_mode": type(mode).__qualname__, **settings, **self.variations.definition}

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
        return self.mdp.initial_state(self.mdp.sensors.read(self.simulation), draws)

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up what the task needs beside the MDP in a compiled scene."""

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates observables and colours after a change of state; `physics` is None where a state has been set."""

    def action_spec(self, physics: mjcf.Physics) -> specs.Array:
        return self.mdp.action_mode.spec(self.robot)

    def after_compile(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self.random = random_state
        self.simulation = PhysicsSimulation(physics)
        self.mdp.sensors.bind(physics)
        self.mdp.action_mode.bind(physics, self.robot, self.control_timestep)
        self.variations.bind(physics)
        varied = {*self.variations.randomizer.names}
        self.parts = {part.name: part for part in self._offered_parts if part.takes_part(varied)}
        for part in self.parts.values():
            part.bind(physics)
        self.runner = EpisodeRunner(self.mdp, self.simulation, self.mdp.sensors, self.parts)
        (self._action_size,) = self.action_spec(physics).shape
        self.bind(physics)
        self._set_episode(self.runner.start(self, physics, NoDraws(), self.episode), physics)
        self._find_sizes()

    def _measured(self) -> Measured:
        measured: Measured = self.episode.parts[self.observations.name]
        return measured

    def _find_sizes(self) -> None:
        """Finds the numbers of elements of the observations, which are known once the scene is compiled."""
        sizes = {name: part.stop - part.start for name, part in self.quantities.slices.items()}
        if self.observations.by_name:
            measured = self._measured()
            sizes |= {name: self.observations.shown(measured, name).size for name in self.observations.enabled}
        self.extra_slices = end_to_end(sizes)
        self.extra_size = sum(sizes.values())
        read = {key: term.read(self.simulation, self.state) for key, term in self.mdp.observations.items()}
        own = {key: np.size(value) for key, value in read.items()}
        self.flat_slices = end_to_end({**own, **sizes})
        self.policy_inputs = self.make_policy_inputs(sum(own.values()) + self.extra_size)

    def make_policy_inputs(self, state_size: int) -> PolicyInputs:
        """Returns the observation as trained policies take it, given the number of elements of the state."""
        return PolicyInputs(names=(type(self).__name__,), state_size=state_size)

    def make_records(self) -> Records:
        """Returns what reads metrics and completions of the domain's tasks; not called with `extra_successes`."""
        return Records(self)

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self.random = random_state
        reset = self._reset
        self._reset = Reset()
        self._set_episode(self.runner.reset(self, physics, random_state, reset, self.episode), physics)

    def read_evaluated(self) -> None:
        """Measures what is not saved anew, in a physics that is evaluated after a reset or a saved state."""
        self.episode = self.runner.evaluated(self.episode)

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
        self.random = random_state
        self.has_begun_step = False
        checked = self.checked_action(action)
        self.has_begun_step = True
        if self.mdp.action_mode.reads_derived and not physics.legacy_step:
            mujoco.mj_step1(physics.model.ptr, physics.data.ptr)
        self._draws = SingleDraws(random_state)
        self._acting = self.runner.act(self.episode, checked, self._draws)

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self.random = random_state
        if not physics.legacy_step:
            # MuJoCo's own step leaves kinematics and sensors as they were before it.
            self.runner.refresh(physics)
        self._set_episode(self.runner.advance(self.episode, self._acting, self._draws), physics)

    def get_reward(self, physics: mjcf.Physics) -> float:
        return float(self.mdp.reward(self.state))

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        return self._terminates or self.truncates

    def get_discount(self, physics: mjcf.Physics) -> float:
        return 0.0 if self._terminates else 1.0

    def set_mdp_state(self, state: Any, physics: mjcf.Physics | None = None) -> None:
        """Sets the MDP's state, and publishes it."""
        self._set_episode(self.episode._replace(mdp_state=state), physics)

    def _set_episode(self, episode: EpisodeState, physics: mjcf.Physics | None) -> None:
        """Sets the state of the episode, and publishes it."""
        self.episode = episode
        # composer asks for both of them twice.
        self._terminates = bool(self.runner.terminates(episode))
        self.truncates = bool(self.mdp.truncates(episode.mdp_state))
        self.publish(physics)

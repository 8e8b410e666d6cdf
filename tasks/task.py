"""The base of the suite's tasks: steps and resets by the task's MDP, beyond the interface of `composer.Task`."""

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
import tree
from dm_control import mjcf
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.franka import Franka
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks import episode
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.instructions import InstructedTask
from kitchen_suite.tasks.mdp import MDP, MEDIAN, ActionMode, PhysicsSimulation, columns
from kitchen_suite.tasks.observables import ObservedTask
from kitchen_suite.tasks.variations.distributions import ParameterVariation
from kitchen_suite.tasks.variations.variations import Variations

# Number of axes of an observed picture.
_PICTURE_AXES = 3


class LearnedTask(abc.ABC):
    """A task that trained policies act in."""

    @property
    @abc.abstractmethod
    def observation_size(self) -> int:
        """Number of elements of the flat observation, goals included."""

    @property
    def state_size(self) -> int:
        """Number of elements at the beginning of the flat observation that are no goals and no requests of tasks."""
        return self.observation_size

    @property
    def task_names(self) -> tuple[str, ...]:
        """Names of the tasks that episodes may ask for; empty if the task has no parts."""
        return ()

    def policy_inputs(self, observation: Mapping[str, NDArray], tasks: Sequence[str]) -> NDArray[np.float64]:
        """Returns the inputs `(m,)` of a policy without goals: the state, and 1 for each of `tasks` that is asked.

        Args:
          observation: of a dm_env time step.
          tasks: names, in the order of the policy.
        """
        del tasks
        flat = [np.ravel(array) for array in observation.values() if np.ndim(array) < _PICTURE_AXES]
        return np.concatenate(flat)[: self.state_size]

    @property
    def policy_key(self) -> str:
        """Name of trained policies for the task; equal for tasks that differ neither in goals nor in rewards."""
        return type(self).__name__

    @property
    def general_policy_keys(self) -> tuple[str, ...]:
        """Names of trained policies for more than the task, which can be asked for the task alone."""
        return ()


# Verdicts, measures, and the control steps at which goals were completed, by the goals' names.
Metrics = dict[str, bool | float | dict[str, int]]


class Completions(NamedTuple):
    """The tasks of an episode that asks for several.

    Attributes:
      tasks: the names of all `n` tasks.
      asked: `(n,)`, which of them the episode asks for.
      steps: `(n,)`, control step, from 1, at which each was first completed; not positive where it was not.
    """

    tasks: tuple[str, ...]
    asked: NDArray[np.bool_]
    steps: NDArray[np.int64]

    @property
    def steps_by_task(self) -> dict[str, int | None]:
        """The tasks that are asked for, each with the control step of its completion or None."""
        rows = zip(self.tasks, self.asked.tolist(), self.steps.tolist(), strict=True)
        return {name: step if step > 0 else None for name, is_asked, step in rows if is_asked}


class MeasuredTask(abc.ABC):
    """A task with metrics of its episodes, read from their infos."""

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
        del infos
        return None

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        """Names of the task's goals, and whether each is reached after each step of a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.

        Returns:
          `n` names and a mask `(T + 1, n)`; None if the arrays do not determine it.
        """
        return None


class OptionedTask:
    """A task whose resets may take options of its own.

    Attributes:
      reset_options: names of the options.
    """

    reset_options: ClassVar[tuple[str, ...]] = ()

    @property
    def drawn_tasks(self) -> tuple[str, ...]:
        """Names of the tasks of which each episode draws some; empty if every episode asks for the same."""
        return ()

    def reset_request(self, options: Mapping[str, Any]) -> Any:
        """Returns the checked request for a reset of one episode; None if the options have none.

        Args:
          options: of the reset, among them those of `reset_options`.

        Raises:
          TypeError: an option is of the wrong type.
          ValueError: an option has a value that the task refuses.
        """
        del options
        return None

    def request_reset(self, request: Any) -> None:
        """Makes the next reset follow a request that `reset_request` returned."""

    def recorded_options(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        """Returns the options of a reset that repeat what was drawn in a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.
        """
        del arrays
        return {}


# Colour of objects that the task counts as a success.
SUCCESS_RGBA = (0.25, 0.75, 0.3, 1.0)


class SuiteTask(InstructedTask, LearnedTask, OptionedTask, MeasuredTask, ObservedTask):
    """A task with saved states, metrics of its episodes, and optional highlighting of success.

    Attributes:
      domain_name: name of the task's domain in the suite, whose expert acts in it; None for a task outside the suite.
      control_modes: the task's control modes by name, the default first; empty if it has only one.
      truncates: whether the last step truncated the episode, whatever the environment's time limit.
      varied: the parameters that groups vary, in the order in which they are drawn.
      variations: the parameters that vary in this task; its constructor sets them.
    """

    domain_name: str | None = None
    varied: ClassVar[Sequence[ParameterVariation]] = ()
    variations: Variations
    truncates = False
    control_modes: ClassVar[Mapping[str, Callable[..., ActionMode]]] = MappingProxyType({})
    _random: np.random.RandomState
    _state: Any = None
    _command: Any = ()
    _sensing: Any = ()
    _visualize_reward = False

    @property
    def random(self) -> np.random.RandomState:
        """The random state that the environment last passed to the task."""
        return self._random

    @property
    def visualize_reward(self) -> bool:
        """Whether objects change their colour while the task rewards their position."""
        return self._visualize_reward

    @visualize_reward.setter
    def visualize_reward(self, value: bool) -> None:
        self._visualize_reward = checks.boolean(value, "visualize_reward")

    @property
    @abc.abstractmethod
    def mdp(self) -> MDP:
        """The task's settings, and the mathematics of an episode under them."""

    @property
    @abc.abstractmethod
    def robot(self) -> Franka:
        """The robot that acts."""

    @property
    def state(self) -> Any:
        """The MDP's state of the present episode; arrays without leading axes, not to be written to."""
        return self._state

    @property
    def default_control_mode(self) -> str:
        """Name of the control mode where none is asked for."""
        return next(iter(self.control_modes), self.mdp.action_mode.name)

    @property
    def command(self) -> Any:
        """Memory of the control mode from earlier actions, such as a commanded pose; `()` if it has none."""
        return self._command

    @property
    def sensing(self) -> Any:
        """Variation of sensing in the present episode, a `sensing.Sensing`; `()` if there is none."""
        return self._sensing

    @property
    def episode_metrics(self) -> Metrics:
        """Metrics of the present episode up to the last control step; see `metrics`."""
        return self.metrics(self.mdp.info(self.state))

    @property
    def episode_completions(self) -> Completions | None:
        """Tasks that the present episode asks for and has completed; None if they cannot be counted."""
        return self.completions_in(self.mdp.info(self.state))

    def begin_run(self) -> None:
        """Resets all memory of earlier episodes, so that a run does not depend on earlier ones."""
        zeros = {name: np.zeros_like(getattr(self._state, name)) for name in self.mdp.carried}
        self._state = self._state._replace(**zeros)

    def restore(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> None:
        """Moves robot and objects to the positions and velocities of a recorded observation.

        The caller updates what MuJoCo derives from these, as `Environment.set_state` does.

        Raises:
          ValueError: the task's episodes start from a seed only.
        """
        raise ValueError(f"an episode of {type(self).__name__} can be repeated only from its seed, which is missing")

    def set_observed_positions(self, observation: NDArray[np.float64]) -> None:
        """Makes the next action start from the robot's positions in a recorded observation.

        Raises:
          ValueError: the task's episodes start from a seed only.
        """
        raise ValueError(f"an episode of {type(self).__name__} can be repeated only from its seed, which is missing")

    def is_initial(self, physics: mjcf.Physics, observation: NDArray[np.float64]) -> bool:
        """Whether a recorded observation is one of the present physics state, up to noise and rounding."""
        return True

    def get_state(self) -> dict[str, Any]:
        """Returns the task's state beside the physics: nested dicts of strings and fresh arrays."""
        memory = {name: part._asdict() for name, part in self._memory.items() if part}
        return {**self._saved_state(), **tree.map_structure(np.array, memory), **self.variations.info}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Sets a state that `get_state` returned.

        Raises:
          TypeError: an element is of the wrong type.
          ValueError: an element is missing, is of another task, has the wrong shape or is out of range; the task is
            unchanged then.
        """
        state = checks.matching(state, self.get_state(), "task state")
        values = self.variations.randomizer.checked(self._values_in(state))
        self._restore_state(state)
        self.variations.restore(values, int(state.get("layout_refusals", 0)))
        memory = (part and part._replace(**state[name]) for name, part in self._memory.items())
        self._command, self._sensing = memory

    def _values_in(self, state: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
        """Returns the values of all parameters in a state that `get_state` returned."""
        return dict(state.get("variation_values", {}))

    @property
    def _memory(self) -> dict[str, Any]:
        """Named tuples of what later steps depend on, beside the MDP's state; `()` where there is nothing."""
        return {"command": self._command, "sensing": self._sensing}

    def _saved_state(self) -> dict[str, Any]:
        """Returns what `get_state` returns of the MDP's state, and what else the task keeps."""
        return tree.map_structure(np.array, self._state._asdict())

    def _restore_state(self, state: Mapping[str, Any]) -> None:
        """Sets what `_saved_state` returned; raises a ValueError, with nothing changed, where it does not fit."""
        self._set_state(type(self._state)(**{name: state[name] for name in self._state._fields}))

    @abc.abstractmethod
    def _reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Moves robot and objects to the start of an episode."""

    def _bind(self, physics: mjcf.Physics) -> None:
        """Looks up what the task needs beside the MDP in a compiled scene."""

    @abc.abstractmethod
    def _show(self, physics: mjcf.Physics | None) -> None:
        """Updates observables and, given a physics, colours after a change of state."""

    def action_spec(self, physics: mjcf.Physics) -> specs.Array:
        del physics
        return self.mdp.action_mode.spec(self.robot)

    def after_compile(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random = random_state
        mdp, self._simulation = self.mdp, PhysicsSimulation(physics)
        mdp.sensors.bind(physics)
        mdp.action_mode.bind(physics, self.robot, self.control_timestep)
        self.variations.bind(physics)
        self._joint_columns = columns(physics.bind(self.robot.joints).qposadr)
        if self._extras is not None:
            self._extras.bind(physics)
        (self._action_size,) = self.action_spec(physics).shape
        self._bind(physics)
        self._start(physics, np.zeros(mdp.noise_draws))

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random = random_state
        self._reset_physics(physics, random_state)
        self.variations.draw(physics, random_state)
        self._start(physics, self.mdp.draw_noise(random_state))

    def checked_action(self, action: ArrayLike) -> NDArray[np.float64]:
        """Returns an action as a fresh float64 array; raises as `before_step`."""
        checked = checks.vector(action, self._action_size, "action").copy()
        self.mdp.action_mode.check(checked)
        return checked

    def before_step(self, physics: mjcf.Physics, action: ArrayLike, random_state: np.random.RandomState) -> None:
        """Sets the actuators' targets for the whole control step.

        Raises:
          TypeError: the action does not hold real numbers.
          ValueError: the action has another shape than its spec, holds NaN or inf, or has no meaning.
        """
        self._random, mdp = random_state, self.mdp
        self._action = self.checked_action(action)
        if mdp.action_mode.reads_derived and not physics.legacy_step:
            mujoco.mj_step1(physics.model.ptr, physics.data.ptr)
        draw = random_state.random_sample() if mdp.action_mode.draws else MEDIAN
        self._target, self._command = mdp.action_mode.control(
            self._simulation, self._state, self._command, self._action, draw
        )
        applied, self._sensing = episode.applied(self._sensing, self._target)
        self._simulation.write("ctrl", mdp.sensors.ctrl, applied)

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random, mdp = random_state, self.mdp
        if not physics.legacy_step:
            # MuJoCo's own step leaves kinematics and sensors as they were before it.
            mdp.sensors.refresh(physics)
            if self._extras is not None:
                self._extras.refresh(physics)
        state = mdp.step(
            self._state,
            action=self._action,
            target=self._target,
            reading=mdp.sensors.read(self._simulation),
            draws=episode.scaled(self._sensing, mdp.draw_noise(random_state)),
        )
        self._set_state(state, physics)

    def get_reward(self, physics: mjcf.Physics) -> float:
        del physics
        return float(self.mdp.reward(self._state))

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        del physics
        return self._terminates or self.truncates

    def get_discount(self, physics: mjcf.Physics) -> float:
        del physics
        return 0.0 if self._terminates else 1.0

    def _start(self, physics: mjcf.Physics, draws: NDArray[np.float64]) -> None:
        """Sets the state before the first step; `draws` as in `MDP.initial_state`."""
        mdp, before = self.mdp, self._state
        mdp.sensors.refresh(physics)
        positions = np.array(self._simulation.read("qpos", self._joint_columns))
        self._sensing = episode.start(self.variations.randomizer.values, mdp.noise_parts, mdp.noise_draws, positions)
        start = self._initial_state(episode.scaled(self._sensing, draws))
        carried = {} if before is None else {name: getattr(before, name) for name in mdp.carried}
        self._set_state(start._replace(**carried), physics)
        self._start_command(physics)

    def _initial_state(self, draws: NDArray[np.float64]) -> Any:
        """Returns the state before the first step; `draws` as in `MDP.initial_state`."""
        return self.mdp.initial_state(self.mdp.sensors.read(self._simulation), draws)

    def _start_command(self, physics: mjcf.Physics) -> None:
        """Makes the control mode start from the present state of the physics."""
        if self.mdp.action_mode.reads_derived:
            mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        self._command = self.mdp.action_mode.start(self._simulation)

    def _set_state(self, state: Any, physics: mjcf.Physics | None = None) -> None:
        """Stores a state, and shows it."""
        self._state = state
        # composer asks twice.
        self._terminates, self.truncates = bool(self.mdp.terminates(state)), bool(self.mdp.truncates(state))
        self._show(physics)


class GoalHighlighting:
    """Colours of the objects of some tasks: their own, or green."""

    def __init__(self, physics: mjcf.Physics, scene: Scene, goals: GoalSet) -> None:
        """Finds the geoms that move with each task's joints, and stores their own colours."""
        self._physics = physics
        self._geoms = [
            [geom for joint in goal.joints_in(scene) for geom in joint.parent.find_all("geom")] for goal in goals.goals
        ]
        self._own_rgba = [np.array(physics.bind(geoms).rgba) for geoms in self._geoms]

    def update(self, within: Iterable[bool]) -> None:
        """Colours the objects of tasks `within` their thresholds green, and restores the others' own colours."""
        for geoms, own_rgba, is_within in zip(self._geoms, self._own_rgba, within, strict=True):
            self._physics.bind(geoms).rgba = SUCCESS_RGBA if is_within else own_rgba

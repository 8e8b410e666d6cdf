"""Markov decision processes: the mathematics of a task's episodes."""

import abc
import dataclasses
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.control_modes.action_mode import ActionMode
from kitchen_suite.tasks.sensors import Sensors
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Observation, RewardTerm, Transition, total
from kitchen_suite.types import Array

Reading = TypeVar("Reading")
State = TypeVar("State", bound=tuple)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MDP(abc.ABC, Generic[Reading, State]):
    """Settings of a task, and the mathematics of its episodes: control, next state, reward, observation, infos.

    States are named tuples of arrays with any leading axes `(...)`: none for one episode, one for many. No method
    changes a state.

    Attributes:
      sensors: sensors of the scene, bound to its compiled model.
      action_mode: meaning of the action.
      rewards: the terms of the reward by name; their sum is the reward.
      persistent: fields of the state that a reset leaves as they are: numbers of control steps over all episodes.
      object_slots: places that are kept for joints of props, where props differ between episodes stepped together.
    """

    sensors: Sensors[Reading]
    action_mode: ActionMode
    rewards: Mapping[str, RewardTerm]
    persistent: ClassVar[Sequence[str]] = ()
    object_slots: ClassVar[int] = 0

    @property
    def noise_draws(self) -> int:
        """Number of numbers drawn from U(-1, 1) at a reset and after each step; 0 without noise."""
        return 0

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        """Parts of these numbers that variations can scale, by name."""
        return {"noise": slice(self.noise_draws)} if self.noise_draws else {}

    @abc.abstractmethod
    def initial_state(self, reading: Reading, draws: Array) -> State:
        """Returns the state before the first step.

        Args:
          reading: present values of the sensors.
          draws: `(..., noise_draws)`, from U(-1, 1).
        """

    @abc.abstractmethod
    def transition(
        self, state: State, *, action: Array, target: Array, reading: Reading, draws: Array
    ) -> Transition[State]:
        """Returns one more control step, whose state has no terms of the reward yet.

        Args:
          state: the state before it.
          action: `(..., k)`, its action.
          target: `(..., m)`, targets of the actuators during it, each in its unit.
          reading: values of the sensors after it.
          draws: `(..., noise_draws)`, from U(-1, 1).
        """

    def step(self, state: State, **arguments: Any) -> Any:
        """Returns the state after one more control step without extra observations; arguments as in `transition`."""
        return self.rewarded(self.transition(state, **arguments))

    @property
    @abc.abstractmethod
    def observations(self) -> Mapping[str, Observation]:
        """Observations of the state by key, in the order of the flat observation."""

    @property
    def goal_observations(self) -> Mapping[str, Observation]:
        """The goals that agents observe, by key: values of all tasks end to end, in the order of `goals`.

        Only an MDP with `goals`, a `GoalSet`, has any.
        """
        return MappingProxyType({})

    @property
    def request_observations(self) -> Mapping[str, Observation]:
        """Observations of the requests of episodes by key, in order."""
        return MappingProxyType({})

    @property
    def has_goal_pictures(self) -> bool:
        """Whether agents that observe pictures observe pictures of the goal as well."""
        return False

    def goal_pictures(self, state: State) -> NDArray[np.uint8]:
        """Returns pictures `(..., c, height, width, 3)` of the goal, one by each of the task's cameras."""
        raise NotImplementedError("there are no pictures of goals")

    @property
    def noisy_observations(self) -> Collection[str]:
        """Keys of those `observations` to which `corrupted` adds noise."""
        return ()

    def corrupted(self, key: str, clean: Any, state: State) -> Any:
        """Returns one of the `observations`, `(..., k)`, with the noise that the state holds."""
        return clean

    def observation(self, simulation: Simulation, state: State) -> NDArray:
        """Returns the flat observation `(..., m)` without goals and requests, with its noise."""
        parts = [self.corrupted(key, term.read(simulation, state), state) for key, term in self.observations.items()]
        return np.concatenate(parts, axis=-1)

    def rewarded(self, step: Transition) -> Any:
        """Returns the state after a step with the terms of its reward."""
        return step.after._replace(terms={name: term(step) for name, term in self.rewards.items()})

    def no_reward(self, axes: tuple[int, ...]) -> dict[str, Array]:
        """Returns the terms before the first step: zeros of the shape `axes`."""
        return {name: np.zeros(axes) for name in self.rewards}

    def reward(self, state: State) -> Array:
        """Returns the reward `(...)` of the last step: the sum of the terms that the state holds."""
        return total(state.terms)  # type: ignore[attr-defined]

    @abc.abstractmethod
    def terminates(self, state: State) -> NDArray[np.bool_]:
        """Returns whether `(...)` the last step terminated the episode."""

    def task_joints(self, scene: Scene) -> Sequence[Sequence[mjcf.Element]]:
        """Returns the joints that each of the `n` tasks moves, which a push can undo; by default there are none.

        An MDP that overrides it overrides `complete` as well.
        """
        return ()

    def complete(self, state: State) -> NDArray[np.bool_]:
        """Returns which tasks `(..., n)` have been completed and still are: those of `task_joints` come first.

        There may be more, which are never complete, where props differ between episodes stepped together.
        """
        return np.zeros(0, bool)

    def succeeds(self, state: State) -> NDArray[np.bool_]:
        """Returns whether `(...)` all that the episode asks for holds after the last step.

        By default it is the info `is_success`. An MDP whose success lasts once it is reached overrides it.
        """
        return np.array(self.info(state)["is_success"])

    def requested_joints(self, scene: Scene, state: State) -> Collection[mjcf.Element]:
        """Returns the joints that an episode asks to move, given its state; by default those of all tasks."""
        return [joint for joints in self.task_joints(scene) for joint in joints]

    def carried_joints(self, scene: Scene) -> Sequence[mjcf.Element | None]:
        """Returns the free joints of the objects whose collisions in the hand `quality` measures; by default of none.

        Where props differ between episodes stepped together, the sequences are equally long: None fills the rest.
        """
        return ()

    def truncates(self, state: State) -> NDArray[np.bool_] | bool:
        """Returns whether `(...)` the last step truncated the episode, whatever its time limit; by default never."""
        return False

    @abc.abstractmethod
    def info(self, state: State) -> dict[str, NDArray]:
        """Returns the infos on the task, often with those of `reward_info`: fresh arrays `(...)` or `(..., n)`."""

    def reward_info(self, state: State) -> dict[str, NDArray]:
        """Returns the terms of the last step's reward as infos have them: fresh arrays `(...)` by `reward/<name>`."""
        return {f"reward/{name}": np.array(term) for name, term in state.terms.items()}  # type: ignore[attr-defined]

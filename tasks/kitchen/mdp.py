"""The kitchen's Markov decision process: the state after a control step, its reward, observation and infos."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.completion_mdp import CompletionMDP
from kitchen_suite.tasks.goals import GoalSet, Progress, Success
from kitchen_suite.tasks.kitchen.observation import KitchenReading, KitchenSensors
from kitchen_suite.tasks.kitchen.requests import GOAL_STATES
from kitchen_suite.tasks.kitchen.shaping import Shaping, task_shares
from kitchen_suite.tasks.orders import REQUESTED, Ordering, counted_in_order, next_in_turn, order_info
from kitchen_suite.tasks.rewards import SPARSE_TERMS, CompletionStep, Shares, SharesStep
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Observation, Transition
from kitchen_suite.types import Array

# First part of the names of infos from which a dense reward can be computed for other goals.
REWARD_STATE = "reward_state"

# First part of the name of the info on the tasks that a step could complete, where they are requested in turn.
ATTEMPTED = "attempted_tasks"


class KitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 59)`, noise of the present observation.
      positions: `(..., 9)`, positions of the robot's joints, without noise [rad, m].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      achieved: `(..., k)`, achieved goals: present positions of the goals' joints, end to end [rad, m, quaternion].
      distances: `(..., n)`, distance of each task from its goal [rad, m].
      progress: completion of the tasks.
      requested_order: `(..., n)`, order of the tasks that the episode asks for; see `orders`.
      terms: `(...)` each, the terms of the last step's reward by name.
      shaping: state of a dense reward; None for the sparse one.
      goal_states: `(..., 30 k)`, see `requests`; None if none are observed.
      goal_pictures: `(..., c, height, width, 3)`, pictures of the last of them; None without these or cameras.
    """

    noise: Array
    positions: Array
    target: Array
    achieved: Array
    distances: Array
    progress: Progress
    requested_order: NDArray[np.int64]
    terms: dict[str, Array]
    shaping: Shaping | None = None
    goal_states: Array | None = None
    goal_pictures: NDArray[np.uint8] | None = None

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., n)`, tasks that the last step completed."""
        return self.progress.completions

    @property
    def requested(self) -> NDArray[np.bool_]:
        """`(..., n)`, tasks that the episode asks for."""
        return self.requested_order >= 0


def as_dict(state: KitchenState) -> dict[str, Any]:
    """Returns a state as nested dicts of fresh arrays, without the parts that are None or follow from others."""
    fields = state._asdict()
    parts = {"progress": state.progress._asdict()}
    if state.shaping is not None:
        parts["shaping"] = state.shaping._asdict()
    if state.terms.keys() != SPARSE_TERMS:
        parts["terms"] = state.terms
    nested = {name: {key: np.array(array) for key, array in part.items()} for name, part in parts.items()}
    others = fields.keys() - {"progress", "shaping", "terms"}
    flat = {name: part for name, part in fields.items() if name in others and part is not None}
    return {**{name: np.array(array) for name, array in flat.items()}, **nested}


def from_dict(arrays: Mapping[str, Any]) -> KitchenState:
    """Returns the state that `as_dict` returned as nested dicts, among which there may be others."""
    parts = {name: arrays[name] for name in KitchenState._fields if name in arrays}
    if "shaping" in parts:
        parts["shaping"] = Shaping(**parts["shaping"])
    progress = Progress(**parts["progress"])
    terms = {"completion": np.add.reduce(progress.completions, axis=-1, dtype=np.float64)}
    order = np.arange(progress.completions.size)
    return KitchenState(**{"terms": terms, "requested_order": order, **parts, "progress": progress})


class KitchenTransition(Transition[KitchenState], CompletionStep, SharesStep):
    """A control step in the kitchen."""

    def __init__(self, mdp: "KitchenMDP", attempted: NDArray[np.bool_], *parts: Any) -> None:
        """Stores the settings, which tasks `(..., n)` the step could complete, and the parts of a `Transition`."""
        super().__init__(*parts)
        self._mdp = mdp
        self._attempted = attempted

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., n)`, tasks that the step completed."""
        return self.after.completions

    @functools.cached_property
    def shares(self) -> Shares:
        """How far each task has come, before and after the step; for dense rewards alone."""
        mdp, state = self._mdp, self.after
        assert state.shaping is not None, "only a dense reward has a state"
        return task_shares(
            state.shaping,
            success=mdp.success,
            achieved=state.achieved,
            desired=mdp.goals.desired,
            mask=self._attempted,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenMDP(CompletionMDP[KitchenReading, KitchenState]):
    """Settings of a kitchen task, and the mathematics of an episode under them; `KitchenTask` explains the settings.

    Attributes:
      sensors: sensors of robot and objects.
      goals: the tasks, with their goals.
      noise_scale: `(59,)`, greatest noise of each element of the observation.
      initial_qpos: `(30,)` with the Franka, positions of robot and objects at the start [rad, m, quaternion].
      success: decides which tasks are complete.
      remove_task_when_completed: whether a task is rewarded only once.
      ordering: which of the tasks an episode asks for, and in what sequence they count.
      max_task_steps: control steps without a completion after which an episode truncates; None for no limit.
      goal_states: number of goal states that are observed.
    """

    sensors: KitchenSensors
    goals: GoalSet
    noise_scale: Array
    initial_qpos: Array
    success: Success
    remove_task_when_completed: bool
    ordering: Ordering
    max_task_steps: int | None = None
    goal_states: int = 0

    @property
    def noise_draws(self) -> int:
        return self.noise_scale.size

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        return self.sensors.slices.noise

    def initial_state(self, reading: KitchenReading, draws: Array) -> KitchenState:
        distances = self.goals.distances(reading.achieved)
        return KitchenState(
            noise=self.noise_scale * draws,
            positions=reading.positions,
            target=self.sensors.robot.holding_targets(reading.positions),
            achieved=reading.achieved,
            distances=distances,
            progress=Progress.initial(distances.shape),
            requested_order=np.zeros(distances.shape, np.int64) + np.arange(distances.shape[-1]),
            terms=self.no_reward(distances.shape[:-1]),
            shaping=self.start_shaping(reading),
        )

    def with_request(
        self, state: KitchenState, order: NDArray[np.int64], goal_states: Array | None = None
    ) -> KitchenState:
        """Returns the state before the first step of an episode that asks for tasks, and for goal states.

        Args:
          state: of the start.
          order: `(n,)`, of the tasks.
          goal_states: `(30 k,)`, end to end; when omitted, the kitchen's start with the tasks done.
        """
        state = state._replace(requested_order=order, progress=Progress.of_request(order))
        if not self.goal_states:
            return state
        if goal_states is not None:
            return state._replace(goal_states=goal_states)
        return state._replace(goal_states=np.tile(self._state_with(self.current_mask(state)), self.goal_states))

    def goal_state(self, state: KitchenState) -> Array:
        """Returns the last goal state `(..., 30)`; where none is observed, the start with the requested tasks done."""
        if state.goal_states is not None:
            return state.goal_states[..., -self.initial_qpos.size :].copy()
        return np.apply_along_axis(self._state_with, -1, self.current_mask(state))

    def _state_with(self, done: NDArray[np.bool_]) -> Array:
        """Returns the state `(30,)` of the kitchen at its start, but with some of the tasks `(n,)` done."""
        indices = self.sensors.indices
        elements = np.repeat(done, [len(goal.value) for goal in self.goals.goals])
        qpos = np.zeros(indices.state_qpos.max() + 1)
        qpos[indices.state_qpos] = self.initial_qpos
        qpos[indices.goal_qpos[elements]] = self.goals.desired[elements]
        return qpos[indices.state_qpos]

    def current_mask(self, state: KitchenState) -> NDArray[np.bool_]:
        """Returns which tasks `(..., n)` are requested at present."""
        return self.current_order(state) >= 0

    def current_order(self, state: KitchenState) -> NDArray[np.int64]:
        """Returns the order `(..., n)` of the tasks requested at present."""
        order = state.requested_order
        if not self.ordering.in_turn:
            return order
        return np.where(next_in_turn(order, state.progress.completed), order, -1)

    def attempted(self, state: KitchenState) -> NDArray[np.bool_]:
        """Returns which tasks `(..., n)` the next step may complete, or have been completed before."""
        current = self.current_mask(state)
        if self.ordering.in_turn:
            return current | state.progress.completed
        return current

    def start_shaping(self, reading: KitchenReading) -> Shaping | None:
        """Returns the state of a dense reward at a reset; None for the sparse one."""
        if not self.is_dense:
            return None
        assert reading.hand_distances is not None, "the sensors measure the hand"
        return Shaping.start(reading.achieved, reading.hand_distances, self.goals)

    def transition(
        self, state: KitchenState, *, action: Array, target: Array, reading: KitchenReading, draws: Array
    ) -> KitchenTransition:
        achieved = reading.achieved
        attempted = self.attempted(state)
        distances = self.goals.distances(achieved)
        within = self.success.within_distances(distances)
        if within is None:
            within = self.success.within(achieved)
        within = within & attempted
        if self.ordering.in_order:
            within = counted_in_order(within, state.progress.completed)
        after = KitchenState(
            noise=self.noise_scale * draws,
            positions=reading.positions,
            target=target,
            achieved=achieved,
            distances=distances,
            progress=state.progress.update(within, remove_task_when_completed=self.remove_task_when_completed),
            terms={},
            requested_order=state.requested_order,
            goal_states=state.goal_states,
            goal_pictures=state.goal_pictures,
        )
        if self.is_dense:
            after = after._replace(shaping=self._next_shaping(state, reading))
        return KitchenTransition(self, attempted, state, action, target, after)

    def _next_shaping(self, state: KitchenState, reading: KitchenReading) -> Shaping:
        """Returns the state of a dense reward one control step after a state."""
        shaping = state.shaping
        before = state.progress
        assert shaping is not None, "only a dense reward has a state"
        assert reading.hand_distances is not None, "the sensors measure the hand"
        if self.ordering.in_turn:
            shaping = shaping.restarted(before.advanced, state.achieved, self.goals)
        return shaping.after(state.achieved, before.completed, reading.hand_distances, self.goals)

    @functools.cached_property
    def observations(self) -> Mapping[str, Observation]:
        return self.sensors.observations

    @functools.cached_property
    def goal_observations(self) -> Mapping[str, Observation]:
        """The achieved and the desired goals, `(..., k)` each [rad, m, quaternion]; no noise."""
        return {
            "achieved_goal": Observation(lambda simulation, state: state.achieved),
            "desired_goal": Observation(self._desired),
        }

    def _desired(self, simulation: Simulation, state: KitchenState) -> Array:
        """Returns the desired goals `(..., k)`, the same in all episodes."""
        desired = self.goals.desired
        # One episode is read in every step, once for each task.
        if state.achieved.ndim == 1:
            return desired
        return np.broadcast_to(desired, state.achieved.shape)

    @functools.cached_property
    def request_observations(self) -> Mapping[str, Observation]:
        """Observations of an episode's requests, without noise.

        - `goal_states` `(..., 30 k)` [rad, m, quaternion], with `goal_states=k` only: positions of robot and objects
          that are wanted, end to end.
        - `requested_tasks` `(..., n)`, with `tasks_per_episode` only: 1 where a task is requested, 0 elsewhere.
        """
        terms = {}
        if self.goal_states:
            terms[GOAL_STATES] = Observation(lambda simulation, state: state.goal_states)
        if self.ordering.draw is not None:
            terms[REQUESTED] = Observation(
                lambda simulation, state: self.current_mask(state).astype(np.float64), minimum=0.0, maximum=1.0
            )
        return terms

    @property
    def has_goal_pictures(self) -> bool:
        return self.goal_states > 0

    def goal_pictures(self, state: KitchenState) -> NDArray[np.uint8]:
        assert state.goal_pictures is not None, "pictures are observed"
        return state.goal_pictures

    @functools.cached_property
    def noisy_observations(self) -> Mapping[str, slice]:
        """Place of the noise of each noisy observation in that of the state."""
        return self.sensors.noisy_observations

    def corrupted(self, key: str, clean: NDArray, state: KitchenState) -> NDArray:
        place = self.noisy_observations.get(key)
        return clean if place is None else clean + state.noise[..., place]

    def task_joints(self, scene: Scene) -> list[tuple[mjcf.Element, ...]]:
        return [goal.joints_in(scene) for goal in self.goals.goals]

    def requested_joints(self, scene: Scene, state: KitchenState) -> list[mjcf.Element]:
        asked = zip(self.task_joints(scene), state.requested.tolist(), strict=True)
        return [joint for joints, is_asked in asked if is_asked for joint in joints]

    def truncates(self, state: KitchenState) -> NDArray[np.bool_] | bool:
        if self.max_task_steps is None:
            return False
        return state.progress.steps_since_completion >= self.max_task_steps

    def info(self, state: KitchenState) -> dict[str, NDArray]:
        """Returns the infos on the tasks: fresh arrays, `(...)` or, in configured order, `(..., n)`.

        With a dense reward also those on its terms and its state; where episodes draw their tasks on requested ones.
        """
        progress = state.progress
        infos = {
            "tasks_to_complete_mask": progress.remaining.copy(),
            "step_task_completions_mask": progress.completions.copy(),
            "episode_task_completions_mask": progress.completed,
            "completion_steps": progress.completion_steps.copy(),
            "task_distances": state.distances.copy(),
            "is_success": self.all_completed(state),
        }
        if self.ordering.draw is not None:
            infos |= order_info(state.requested_order)
        if self.ordering.in_turn:
            # A step that completes a task has not attempted the next one.
            advanced = progress.advanced[..., np.newaxis]
            infos[f"{ATTEMPTED}_mask"] = np.where(advanced, progress.completed, self.attempted(state))
        infos |= self.reward_info(state)
        if self.is_dense:
            assert state.shaping is not None, "a dense reward has a state"
            infos |= {f"{REWARD_STATE}/{name}": np.array(part) for name, part in state.shaping._asdict().items()}
        return infos

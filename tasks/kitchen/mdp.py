"""The kitchen's Markov decision process: the state after a control step, its reward, observation and infos."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import GoalSet, Progress
from kitchen_suite.tasks.kitchen import observation
from kitchen_suite.tasks.kitchen.observation import KitchenReading, KitchenSensors
from kitchen_suite.tasks.kitchen.requests import REQUESTED, TaskDraw, current
from kitchen_suite.tasks.kitchen.reward import ShapedReward, Shaping, shares
from kitchen_suite.tasks.mdp import MDP, ActionMode, Reward, Simulation, total
from kitchen_suite.tasks.success import Success


class KitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 59)`, noise of the present observation.
      positions: `(..., 9)`, positions of the robot's joints, without noise [rad, m].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      achieved: `(..., k)`, achieved goals: present positions of the goals' joints, end to end [rad, m, quaternion].
      distances: `(..., n)`, distance of each task from its goal [rad, m].
      progress: completion of the tasks.
      shaping: what dense rewards remember; None for the sparse reward.
      terms: `(...)` each, the terms of the last step's dense reward by name; None for the sparse reward.
      requested_order: `(..., n)`, place of each task in the order asked, from 0, and -1 where it is not asked; None if
        every episode asks for all tasks.
    """

    noise: NDArray[np.float64]
    positions: NDArray[np.float64]
    target: NDArray[np.float64]
    achieved: NDArray[np.float64]
    distances: NDArray[np.float64]
    progress: Progress
    shaping: Shaping | None = None
    terms: dict[str, NDArray[np.float64]] | None = None
    requested_order: NDArray[np.int64] | None = None


def as_dict(state: KitchenState) -> dict[str, Any]:
    """Returns a state as nested dicts of fresh arrays, without the fields that are None."""
    parts = {"progress": state.progress._asdict()}
    if state.shaping is not None and state.terms is not None:
        parts |= {"shaping": state.shaping._asdict(), "terms": state.terms}
    nested = {name: {key: np.array(array) for key, array in part.items()} for name, part in parts.items()}
    flat = {name: part for name, part in state._asdict().items() if name not in _NESTED and part is not None}
    arrays = {name: np.array(array) for name, array in flat.items()}
    return {**arrays, **nested}


def from_dict(arrays: Mapping[str, Any]) -> KitchenState:
    """Returns the state that `as_dict` returned as nested dicts, among which there may be others."""
    parts = {name: arrays[name] for name in KitchenState._fields if name in arrays}
    if "shaping" in parts:
        parts["shaping"] = Shaping(**parts["shaping"])
    return KitchenState(**{**parts, "progress": Progress(**parts["progress"])})


_NESTED = ("progress", "shaping", "terms")


# First part of the names of infos from which a dense reward can be computed for other goals.
REWARD_STATE = "reward_state"

# Name of the info on the order of the tasks asked.
REQUESTED_ORDER = "requested_order"

# First part of the name of the info on the tasks that a step could complete, where they are asked in turn.
ATTEMPTED = "attempted_tasks"


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenMDP(MDP[KitchenReading, KitchenState]):
    """Settings of a kitchen task, and the mathematics of an episode under them; `KitchenTask` explains the settings.

    Attributes:
      sensors: sensors of robot and objects.
      action_mode: meaning of the action.
      goals: the tasks, with their goals.
      reward_terms: reward function of a step: of its completions `(..., n)`, or of the tasks' `Shares`.
      noise_scale: `(59,)`, greatest noise of each element of the observation.
      success: decides which tasks are complete.
      terminate_on_tasks_completed: whether an episode terminates once every task has been completed.
      remove_task_when_completed: whether a task is rewarded only once.
      task_draw: how many of the tasks an episode asks for; None for all.
      tasks_in_turn: whether the next of them is asked only once the one before has been completed.
      max_task_steps: control steps without a completion after which an episode truncates; None for no limit.
    """

    sensors: KitchenSensors
    action_mode: ActionMode
    goals: GoalSet
    reward_terms: Reward
    noise_scale: NDArray[np.float64]
    success: Success
    terminate_on_tasks_completed: bool
    remove_task_when_completed: bool
    task_draw: TaskDraw | None = None
    tasks_in_turn: bool = False
    max_task_steps: int | None = None

    @property
    def noise_draws(self) -> int:
        return self.noise_scale.size

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        return observation.PARTS

    def initial_state(self, reading: KitchenReading, draws: NDArray[np.float64]) -> KitchenState:
        distances = self.goals.distances(reading.achieved)
        shaping = self.start_shaping(reading)
        return KitchenState(
            noise=self.noise_scale * draws,
            positions=reading.positions,
            target=reading.positions,
            achieved=reading.achieved,
            distances=distances,
            progress=Progress.initial(distances.shape),
            shaping=shaping,
            terms={name: np.zeros(distances.shape[:-1]) for name in self.reward_terms.terms} if shaping else None,
        )

    def asked(self, state: KitchenState, order: NDArray[np.int64]) -> KitchenState:
        """Returns the state before the first step of an episode that asks for some tasks; see `requested`."""
        return state._replace(requested_order=order, progress=state.progress._replace(remaining=order >= 0))

    @property
    def request_key(self) -> str:
        """How tasks are asked for, in the names of trained policies; empty if every episode asks for all."""
        if self.task_draw is None:
            return ""
        return "_in_turn" if self.tasks_in_turn or self.task_draw.most == 1 else "_random"

    def shown_mask(self, state: KitchenState) -> NDArray[np.bool_]:
        """Returns which tasks `(..., n)` are asked at present."""
        order = self.shown_order(state)
        return np.full(state.distances.shape, True) if order is None else order >= 0

    def shown_order(self, state: KitchenState) -> NDArray[np.int64] | None:
        """Returns the order `(..., n)` of the tasks that are asked at present; None if every episode asks for all."""
        order = state.requested_order
        if not self.tasks_in_turn or order is None:
            return order
        return np.where(current(order, state.progress.completed), order, -1)

    def _attempted(self, state: KitchenState) -> NDArray[np.bool_]:
        """Returns which tasks `(..., n)` the next step may complete, or has completed before."""
        shown = self.shown_mask(state)
        return shown | state.progress.completed if self.tasks_in_turn else shown

    def start_shaping(self, reading: KitchenReading) -> Shaping | None:
        """Returns what a dense reward remembers at a reset; None for the sparse one."""
        if reading.hand_distances is None:
            return None
        return Shaping.start(reading.achieved, reading.hand_distances, self.goals)

    def step(
        self,
        state: KitchenState,
        *,
        action: NDArray[np.float64],
        target: NDArray[np.float64],
        reading: KitchenReading,
        draws: NDArray[np.float64],
    ) -> KitchenState:
        del action
        positions, achieved, hand_distances = reading
        distances = self.goals.distances(achieved)
        within, order = self.success.within(achieved, distances), state.requested_order
        if order is not None:
            within = within & self._attempted(state)
        progress = state.progress.update(within, remove_task_when_completed=self.remove_task_when_completed)
        after = KitchenState(
            self.noise_scale * draws, positions, target, achieved, distances, progress, requested_order=order
        )
        return after if hand_distances is None else self._shaped(after, state, hand_distances)

    def _shaped(self, after: KitchenState, before: KitchenState, hand_distances: NDArray[np.float64]) -> KitchenState:
        """Returns a state with the terms of a dense reward."""
        remembered = before.shaping
        assert remembered is not None
        if self.tasks_in_turn:
            remembered = remembered.restarted(before.progress.advanced, before.achieved, self.goals)
        shaping = remembered.after(before.achieved, before.progress.completed, hand_distances, self.goals)
        asked = None if after.requested_order is None else self._attempted(before)
        terms = self.shaped_terms(shaping, after.achieved, self.goals.desired, asked)
        return after._replace(shaping=shaping, terms=terms)

    @property
    def is_shaped(self) -> bool:
        """Whether the reward is a dense one, which depends on more than completions."""
        return isinstance(self.reward_terms, ShapedReward)

    def shaped_terms(
        self,
        shaping: Shaping,
        achieved: NDArray[np.float64],
        desired: NDArray[np.float64],
        asked: NDArray[np.bool_] | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` of a dense reward for goals `(..., k)`; see `shaping.shares`.

        Tasks outside the mask `asked`, `(..., n)`, add nothing.
        """
        each = shares(shaping, success=self.success, achieved=achieved, desired=desired)
        return self.reward_terms(each if asked is None else each.masked(asked))

    def observation(self, simulation: Simulation, state: KitchenState) -> NDArray[np.float64]:
        return self.sensors.observed(simulation) + state.noise

    def reward(self, state: KitchenState) -> NDArray[np.float64]:
        return total(self.terms(state))

    def terms(self, state: KitchenState) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` of the last step's reward by name."""
        return dict(state.terms) if state.terms is not None else self.reward_terms(state.progress.completions)

    def terminates(self, state: KitchenState) -> NDArray[np.bool_]:
        return self.all_completed(state) & self.terminate_on_tasks_completed

    def truncates(self, state: KitchenState) -> NDArray[np.bool_] | bool:
        if self.max_task_steps is None:
            return False
        return state.progress.steps_since_completion >= self.max_task_steps

    def all_completed(self, state: KitchenState) -> NDArray[np.bool_]:
        """Returns whether `(...)` all tasks that the episode asks for have been completed."""
        order = state.requested_order
        if order is None:
            return state.progress.all_completed
        completed: NDArray[np.bool_] = np.logical_and.reduce(state.progress.completed | (order < 0), axis=-1)
        return completed

    def info(self, state: KitchenState) -> dict[str, NDArray]:
        """Returns the infos on the tasks: fresh arrays, `(...)` or, in configured order, `(..., n)`.

        With a dense reward also those on its terms, and what it remembers; with `task_draw` those on the tasks asked.
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
        if state.requested_order is not None:
            infos |= {f"{REQUESTED}_mask": state.requested_order >= 0, REQUESTED_ORDER: state.requested_order.copy()}
        if self.tasks_in_turn:
            # A step that completes a task has not attempted the next one.
            attempted = np.where(progress.advanced[..., np.newaxis], progress.completed, self._attempted(state))
            infos[f"{ATTEMPTED}_mask"] = attempted
        if state.shaping is not None:
            infos |= {f"reward/{name}": np.array(term) for name, term in self.terms(state).items()}
            infos |= {f"{REWARD_STATE}/{name}": np.array(part) for name, part in state.shaping._asdict().items()}
        return infos

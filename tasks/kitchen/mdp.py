"""The kitchen's Markov decision process: the state after a control step, its reward, observation and infos."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.goals import GoalSet, Progress
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.reward import SparseReward
from kitchen_suite.tasks.kitchen.sensors import KitchenReading, KitchenSensors
from kitchen_suite.tasks.kitchen.state import KitchenState
from kitchen_suite.tasks.mdp import MDP, ActionMode
from kitchen_suite.tasks.rewards import total
from kitchen_suite.tasks.simulation import Simulation


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenMDP(MDP[KitchenReading, KitchenState]):
    """Settings of a kitchen task, and the mathematics of an episode under them; `KitchenTask` explains the settings.

    Attributes:
      sensors: sensors of robot and objects.
      action_mode: meaning of the action.
      goals: the tasks, with their goals.
      reward_terms: reward function of the tasks completed in a step.
      noise_scale: `(59,)`, greatest noise of each element of the observation.
      threshold: distance below which a task is complete [rad, m].
      terminate_on_tasks_completed: whether an episode terminates once every task has been completed.
      remove_task_when_completed: whether a task is rewarded only once.
    """

    sensors: KitchenSensors
    action_mode: ActionMode
    goals: GoalSet
    reward_terms: SparseReward
    noise_scale: NDArray[np.float64]
    threshold: float
    terminate_on_tasks_completed: bool
    remove_task_when_completed: bool

    @property
    def noise_draws(self) -> int:
        return self.noise_scale.size

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        return noise.PARTS

    def initial_state(self, reading: KitchenReading, draws: NDArray[np.float64]) -> KitchenState:
        distances = self.goals.distances(reading.achieved)
        return KitchenState(
            noise=self.noise_scale * draws,
            positions=reading.positions,
            target=reading.positions,
            achieved=reading.achieved,
            distances=distances,
            progress=Progress.initial(distances.shape),
        )

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
        positions, achieved = reading
        distances = self.goals.distances(achieved)
        progress = state.progress.update(
            distances < self.threshold, remove_task_when_completed=self.remove_task_when_completed
        )
        return KitchenState(self.noise_scale * draws, positions, target, achieved, distances, progress)

    def observation(self, simulation: Simulation, state: KitchenState) -> NDArray[np.float64]:
        return self.sensors.observed(simulation) + state.noise

    def reward(self, state: KitchenState) -> NDArray[np.float64]:
        return total(self.reward_terms(state.progress.completions))

    def terminates(self, state: KitchenState) -> NDArray[np.bool_]:
        return state.progress.all_completed & self.terminate_on_tasks_completed

    def info(self, state: KitchenState) -> dict[str, NDArray]:
        """Returns the infos on the tasks: fresh arrays, `(...)` or, in configured order, `(..., n)`."""
        progress = state.progress
        return {
            "tasks_to_complete_mask": progress.remaining.copy(),
            "step_task_completions_mask": progress.completions.copy(),
            "episode_task_completions_mask": progress.completed,
            "completion_steps": progress.completion_steps.copy(),
            "task_distances": state.distances.copy(),
            "is_success": progress.all_completed,
        }

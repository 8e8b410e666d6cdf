"""The kitchen's Markov decision process: action to actuator targets, and the state after a control step.

The functions know neither physics nor time. A task keeps the state of one episode; a vectorised environment that of
many, in arrays with one more axis. Both call the same MDP.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.action import position_target
from kitchen_suite.tasks.kitchen.goals import GoalSet, Progress

PHYSICS_TIMESTEP = 0.002  # [s]
CONTROL_TIMESTEP = 0.08  # [s]
FEEDBACKS = ("observed", "true", "target")


class KitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 59)`, noise of the present observation.
      positions: `(..., 9)`, positions of the robot's joints, without noise [rad, m].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      achieved: `(..., k)`, achieved goals: present positions of the goals' joints, end to end [rad, m, quaternion].
      distances: `(..., n)`, distance of each task from its goal [rad, m].
      progress: completion of the tasks.
    """

    noise: NDArray[np.float64]
    positions: NDArray[np.float64]
    target: NDArray[np.float64]
    achieved: NDArray[np.float64]
    distances: NDArray[np.float64]
    progress: Progress


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenMDP:
    """Settings of a kitchen task, and the mathematics of an episode under them; `KitchenTask` explains the settings.

    Attributes:
      goals: the tasks, with their goals.
      noise_scale: `(59,)`, greatest noise of each element of the observation.
      threshold: distance below which a task is complete [rad, m].
      velocity_scale: velocity that a unit of action stands for [rad/s, m/s].
      feedback: one of `FEEDBACKS`.
      terminate_on_tasks_completed: whether an episode terminates once every task has been completed.
      remove_task_when_completed: whether a task is rewarded only once.
    """

    goals: GoalSet
    noise_scale: NDArray[np.float64]
    threshold: float
    velocity_scale: float
    feedback: str
    terminate_on_tasks_completed: bool
    remove_task_when_completed: bool

    def initial_state(self, positions: NDArray, achieved: NDArray, draw: NDArray | float = 0.0) -> KitchenState:
        """Returns the state before the first step; arguments as in `step`, no noise without a draw."""
        distances = self.goals.distances(achieved)
        return KitchenState(
            noise=self.noise_scale * draw,
            positions=positions,
            target=positions,
            achieved=achieved,
            distances=distances,
            progress=Progress.initial(distances.shape),
        )

    def compute_control(self, state: KitchenState, action: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns targets `(..., 9)` of the robot's actuators [rad, m] for an action `(..., 9)`."""
        return position_target(
            self._feedback_positions(state), action, velocity_scale=self.velocity_scale, timestep=CONTROL_TIMESTEP
        )

    def step(
        self, state: KitchenState, *, target: NDArray, positions: NDArray, achieved: NDArray, draw: NDArray
    ) -> KitchenState:
        """Returns the state after one more control step.

        Args:
          state: the state before it.
          target: `(..., 9)`, targets of the actuators during it [rad, m].
          positions: `(..., 9)`, positions of the robot's joints after it [rad, m].
          achieved: `(..., k)`, achieved goals after it [rad, m, quaternion].
          draw: `(..., 59)`, from U(-1, 1), for the noise of the observation.
        """
        distances = self.goals.distances(achieved)
        progress = state.progress.update(
            distances < self.threshold, remove_task_when_completed=self.remove_task_when_completed
        )
        return KitchenState(self.noise_scale * draw, positions, target, achieved, distances, progress)

    def terminates(self, state: KitchenState) -> NDArray[np.bool_]:
        """Whether `(...)` the episode terminates."""
        return state.progress.all_completed & self.terminate_on_tasks_completed

    def info(self, state: KitchenState) -> dict[str, NDArray]:
        """Returns the part of the infos that reports on the tasks: fresh arrays `(..., n)` in configured order."""
        progress = state.progress
        return {
            "tasks_to_complete_mask": progress.remaining.copy(),
            "step_task_completions_mask": progress.completions.copy(),
            "episode_task_completions_mask": progress.completed,
            "completion_steps": progress.completion_steps.copy(),
            "task_distances": state.distances.copy(),
        }

    def _feedback_positions(self, state: KitchenState) -> NDArray[np.float64]:
        """Positions `(..., 9)` from which the velocities of the next action are integrated [rad, m]."""
        if self.feedback == "target":
            return state.target
        if self.feedback == "true":
            return state.positions
        return state.positions + state.noise[..., noise.SLICES[0]]


def as_dict(state: KitchenState) -> dict[str, Any]:
    """Returns a state as nested dicts of fresh arrays."""
    progress = {name: array.copy() for name, array in state.progress._asdict().items()}
    arrays = {name: np.array(array) for name, array in state._asdict().items() if name != "progress"}
    return {**arrays, "progress": progress}

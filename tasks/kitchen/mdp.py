"""The kitchen's rules: what an action commands, and what a control step adds to an episode.

Nothing here knows of physics or of time gone by: a task holds the state of one episode, a vectorised environment that
of many, in arrays with one more axis, and both ask the same rules.
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
    """What an episode remembers from one control step to the next.

    Attributes:
      noise: `(..., 59)`, what is added to the present observation.
      positions: `(..., 9)`, where the robot's joints are [rad, m].
      target: `(..., 9)`, where they were last told to go [rad, m].
      achieved: `(..., k)`, what the goals are about, end to end [rad, m, quaternion].
      distances: `(..., n)`, from the goals of the tasks [rad, m].
      progress: how far the tasks are.
    """

    noise: NDArray[np.float64]
    positions: NDArray[np.float64]
    target: NDArray[np.float64]
    achieved: NDArray[np.float64]
    distances: NDArray[np.float64]
    progress: Progress


@dataclasses.dataclass(frozen=True, kw_only=True)
class KitchenMDP:
    """A kitchen task's settings, and the mathematics of an episode under them; see `KitchenTask` for what they mean.

    Attributes:
      goals: the tasks, with their goals.
      noise_scale: `(59,)`, greatest noise of each number of the observation.
      threshold: [rad, m].
      velocity_scale: [rad/s, m/s].
      feedback: one of `FEEDBACKS`.
      terminate_on_tasks_completed: whether an episode terminates once every task has been completed.
      remove_task_when_completed: whether a task pays once.
    """

    goals: GoalSet
    noise_scale: NDArray[np.float64]
    threshold: float
    velocity_scale: float
    feedback: str
    terminate_on_tasks_completed: bool
    remove_task_when_completed: bool

    def initial_state(self, positions: NDArray, achieved: NDArray, draw: NDArray | float = 0.0) -> KitchenState:
        """The state before the first step; arguments as `advance`, without a draw there is no noise."""
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
        """Targets `(..., 9)` of the robot's servos [rad, m] for an action `(..., 9)`."""
        return position_target(
            self._feedback_positions(state), action, velocity_scale=self.velocity_scale, timestep=CONTROL_TIMESTEP
        )

    def step(
        self, state: KitchenState, *, target: NDArray, positions: NDArray, achieved: NDArray, draw: NDArray
    ) -> KitchenState:
        """The state after one more control step.

        Args:
          state: the one before it.
          target: `(..., 9)`, what was commanded [rad, m].
          positions: `(..., 9)`, where that left the robot's joints [rad, m].
          achieved: `(..., k)`, and what the goals are about [rad, m].
          draw: `(..., 59)`, from U(-1, 1), for the noise of the observation.
        """
        distances = self.goals.distances(achieved)
        progress = state.progress.update(
            distances < self.threshold, remove_task_when_completed=self.remove_task_when_completed
        )
        return KitchenState(self.noise_scale * draw, positions, target, achieved, distances, progress)

    def terminates(self, state: KitchenState) -> NDArray[np.bool_]:
        """Whether `(...)` the episode ends."""
        return state.progress.all_completed & self.terminate_on_tasks_completed

    def _feedback_positions(self, state: KitchenState) -> NDArray[np.float64]:
        """What the velocities of the next action are integrated from."""
        if self.feedback == "target":
            return state.target
        if self.feedback == "true":
            return state.positions
        return state.positions + state.noise[..., noise.PARTS[0]]


def as_dict(state: KitchenState) -> dict[str, Any]:
    """A state as nested dicts of fresh arrays."""
    progress = {name: array.copy() for name, array in state.progress._asdict().items()}
    arrays = {name: np.array(array) for name, array in state._asdict().items() if name != "progress"}
    return {**arrays, "progress": progress}

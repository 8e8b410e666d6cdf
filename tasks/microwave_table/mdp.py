"""The microwave_table domain's Markov decision process: observation, reward, success."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.mdp import MDP, ActionMode, Simulation, total
from kitchen_suite.tasks.sensors import FeatureSensors

PHYSICS_TIMESTEP = 0.005  # [s]
CONTROL_TIMESTEP = 0.01  # [s]

# Slice of each part in the flat observation. Units: rad and m, rad/s and m/s; m; rad; rad/s.
PARTS: Mapping[str, slice] = MappingProxyType(
    {
        "joint_positions": slice(0, 9),
        "joint_velocities": slice(9, 18),
        "handle_offset": slice(18, 21),
        "door_position": slice(21, 22),
        "door_velocity": slice(22, 23),
    }
)
SIZE = 23

# Distance of the fingertips from the handle [m] at which `approach` is about a quarter.
_APPROACH_DISTANCE = 0.1


class MicrowaveTableState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      observation: `(..., 23)`, parts as in `PARTS`.
      terms: `(...)` each, the terms of the last step's reward by name.
      is_success: `(...)`, whether the door is within the threshold of its goal now.
      succeeded: `(...)`, whether it has been after some step.
    """

    observation: NDArray[np.float64]
    terms: dict[str, NDArray[np.float64]]
    is_success: NDArray[np.bool_]
    succeeded: NDArray[np.bool_]


class OpenReward:
    """Dense reward: 1 near the handle, and 5 more where the door is open.

    Attributes:
      terms: names of the terms, which sum to the reward.
    """

    terms = ("approach", "opening")

    def __call__(self, observation: NDArray[np.float64], goal: float) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` by name.

        Args:
          observation: `(..., 23)`, after the control step.
          goal: angle of the open door [rad].
        """
        distance = np.sqrt(rotations.squared_length(observation[..., PARTS["handle_offset"]]))
        share = np.clip(observation[..., PARTS["door_position"].start] / goal, 0.0, 1.0)
        return {"approach": 1.0 - np.tanh(distance / _APPROACH_DISTANCE), "opening": 5.0 * share}


@dataclasses.dataclass(frozen=True, kw_only=True)
class MicrowaveTableMDP(MDP[NDArray[np.float64], MicrowaveTableState]):
    """Settings of the task, and the mathematics of an episode under them.

    Attributes:
      sensors: sensors of robot, handle and door; see `task.MicrowaveTableTask`.
      action_mode: meaning of the action.
      reward_terms: reward function of a step.
      goal: angle of the open door [rad].
      threshold: distance from the goal below which the door counts as open [rad].
    """

    sensors: FeatureSensors
    action_mode: ActionMode
    reward_terms: OpenReward
    goal: float
    threshold: float

    def initial_state(self, reading: NDArray[np.float64], draws: NDArray[np.float64]) -> MicrowaveTableState:
        del draws
        start = self._state(reading, np.zeros(reading.shape[:-1], bool))
        return start._replace(terms={name: np.zeros(reading.shape[:-1]) for name in self.reward_terms.terms})

    def step(
        self,
        state: MicrowaveTableState,
        *,
        action: NDArray[np.float64],
        target: NDArray[np.float64],
        reading: NDArray[np.float64],
        draws: NDArray[np.float64],
    ) -> MicrowaveTableState:
        del action, target, draws
        return self._state(reading, state.succeeded)

    def observation(self, simulation: Simulation, state: MicrowaveTableState) -> NDArray[np.float32]:
        del simulation
        return state.observation.astype(np.float32)

    def reward(self, state: MicrowaveTableState) -> NDArray[np.float64]:
        return total(state.terms)

    def terminates(self, state: MicrowaveTableState) -> NDArray[np.bool_]:
        return np.zeros(state.is_success.shape, bool)

    def info(self, state: MicrowaveTableState) -> dict[str, NDArray]:
        """Returns the infos on door and reward: fresh arrays `(...)`."""
        return {
            **{f"reward/{name}": np.array(term) for name, term in state.terms.items()},
            "door_opening": np.array(state.observation[..., PARTS["door_position"].start] / self.goal),
            "is_success": np.array(state.is_success),
            "success_at_any_time": np.array(state.succeeded),
        }

    def _state(self, reading: NDArray[np.float64], succeeded: NDArray[np.bool_]) -> MicrowaveTableState:
        """Returns the state for sensor values `(..., 26)` and whether `(...)` the door was open before."""
        robot, tcp, handle, door = (reading[..., part] for part in _READING)
        observation = np.concatenate([robot, handle - tcp, door], axis=-1)
        is_success = np.abs(door[..., 0] - self.goal) < self.threshold
        terms = self.reward_terms(observation, self.goal)
        return MicrowaveTableState(observation, terms, is_success, succeeded | is_success)


# Slices of the sensors' values: the robot's joints, fingertips, handle, door; in the order in which the task adds them.
_READING = (slice(0, 18), slice(18, 21), slice(21, 24), slice(24, 26))

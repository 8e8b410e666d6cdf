"""The microwave_table domain's Markov decision process: observation, reward, success."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.sensors import FeatureSensors
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Observation, RewardTerm, Transition, end_to_end
from kitchen_suite.types import Array

CONTROL_TIMESTEP = 0.01  # [s]

# Place of each part in the flat observation. Units: rad and m, rad/s and m/s; m; rad; rad/s.
SLICES = end_to_end(
    {"joint_positions": 9, "joint_velocities": 9, "handle_offset": 3, "door_position": 1, "door_velocity": 1}
)
SIZE = SLICES["door_velocity"].stop
ROBOT_KEYS = ("joint_positions", "joint_velocities")  # Keys of the robot's parts.

# Angle of the open door [rad].
OPEN_ANGLE = -0.75

# Distance of the fingertips from the handle [m] at which `approach` is about a quarter.
_APPROACH_DISTANCE = 0.1


class MicrowaveTableState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      observation: `(..., 23)`, parts as in `SLICES`.
      target: `(..., 9)`, last targets of the actuators [rad, m].
      terms: `(...)` each, the terms of the last step's reward by name.
      is_success: `(...)`, whether the door is within the threshold of its goal now.
      succeeded: `(...)`, whether it has been after some step.
    """

    observation: Array
    target: Array
    terms: dict[str, Array]
    is_success: NDArray[np.bool_]
    succeeded: NDArray[np.bool_]

    @property
    def joint_positions(self) -> Array:
        """`(..., 9)`, of the robot [rad, m]."""
        return self.observation[..., SLICES["joint_positions"]]

    @property
    def joint_velocities(self) -> Array:
        """`(..., 9)`, of the robot [rad/s, m/s]."""
        return self.observation[..., SLICES["joint_velocities"]]

    @property
    def handle_offset(self) -> Array:
        """`(..., 3)`, from the fingertips to the handle [m]."""
        return self.observation[..., SLICES["handle_offset"]]

    @property
    def door_opening(self) -> Array:
        """`(...)`, angle of the door as a share of its goal."""
        return self.observation[..., SLICES["door_position"].start] / OPEN_ANGLE


Step = Transition[MicrowaveTableState]  # What the terms of the reward read.


def approach(step: Step) -> Array:
    """`1 - tanh(d / 0.1)`, `d` the distance of the fingertips from the handle [m]."""
    distance = np.sqrt(rotations.squared_length(step.after.handle_offset))
    return 1.0 - np.tanh(distance / _APPROACH_DISTANCE)


def opening(step: Step) -> Array:
    """`5 * o`, `o` the angle of the door as a share of its goal, in [0, 1]."""
    return 5.0 * np.clip(step.after.door_opening, 0.0, 1.0)


REWARDS: Mapping[str, RewardTerm[Step]] = MappingProxyType({"approach": approach, "opening": opening})
"""The terms of the reward by name: 1 near the handle, and 5 more where the door is open."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MicrowaveTableMDP(MDP[Array, MicrowaveTableState]):
    """Settings of the task, and the mathematics of an episode under them; see `MDP` for those of all tasks.

    Attributes:
      sensors: sensors of robot, handle and door; see `task.MicrowaveTableTask`.
      threshold: distance from the goal below which the door counts as open [rad].
    """

    sensors: FeatureSensors
    rewards: Mapping[str, RewardTerm[Step]]
    threshold: float

    def initial_state(self, reading: Array, draws: Array) -> MicrowaveTableState:
        axes = reading.shape[:-1]
        target = reading[..., self.sensors.indices["joint_positions"]].copy()
        return self._state(reading, target, np.zeros(axes, bool))._replace(terms=self.no_reward(axes))

    def transition(
        self, state: MicrowaveTableState, *, action: Array, target: Array, reading: Array, draws: Array
    ) -> Step:
        return Transition(state, action, target, self._state(reading, target, state.succeeded))

    @functools.cached_property
    def observations(self) -> Mapping[str, Observation]:
        return {key: Observation(self._part(place), of_robot=key in ROBOT_KEYS) for key, place in SLICES.items()}

    @staticmethod
    def _part(place: slice) -> Callable[[Simulation, Any], NDArray[np.float32]]:
        """Returns the function that reads the part at a place."""
        return lambda simulation, state: state.observation[..., place].astype(np.float32)

    def requested_joints(self, scene: Scene, state: MicrowaveTableState) -> tuple[mjcf.Element, ...]:
        return scene.joints("microwave")

    def terminates(self, state: MicrowaveTableState) -> NDArray[np.bool_]:
        return np.zeros(state.is_success.shape, bool)

    def info(self, state: MicrowaveTableState) -> dict[str, NDArray]:
        """Returns the infos on door and reward: fresh arrays `(...)`."""
        return {
            **self.reward_info(state),
            "door_opening": np.array(state.door_opening),
            "is_success": np.array(state.is_success),
            "success_at_any_time": np.array(state.succeeded),
        }

    def _state(self, reading: Array, target: Array, succeeded: NDArray[np.bool_]) -> MicrowaveTableState:
        """Returns the state without reward; `succeeded` is whether `(...)` the door was open before."""
        read = {name: reading[..., part] for name, part in self.sensors.indices.items()}
        parts = {**read, "handle_offset": read["handle_position"] - read["tcp_position"]}
        is_success = np.abs(read["door_position"][..., 0] - OPEN_ANGLE) < self.threshold
        observation = np.concatenate([parts[name] for name in SLICES], axis=-1)
        return MicrowaveTableState(observation, target, {}, is_success, succeeded | is_success)

"""The open_cabinet domain's Markov decision process: state after a control step, reward, observation and infos."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.open_cabinet.features import FEATURE_INDICES, Features, OpenCabinetSensors, scalars
from kitchen_suite.tasks.open_cabinet.observation import LIMIT, ROBOT_KEYS, SIZE, SLICES, clipped, observe
from kitchen_suite.tasks.open_cabinet.rewards import Grip, grip, succeeds, terminates
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Observation, RewardTerm, Transition
from kitchen_suite.types import Array

PHYSICS_TIMESTEP = 0.005  # [s]
CONTROL_TIMESTEP = 0.01  # [s]


class OpenCabinetState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      features: `(..., 36)`, values of the present `Features`.
      observation: `(..., 25)`, the observation without noise, in single precision and clipped.
      noisy_observation: `(..., 25)`, the observation with noise, in single precision and clipped.
      noise: `(..., 25)`, noise of the observation.
      target: `(..., 9)`, last targets of the actuators [rad, m].
      previous_action: `(..., 8)`, action of the last step.
      terms: `(...)` each, the terms of the last step's reward by name.
      terminates: `(...)`, whether the last step terminated the episode.
      succeeded: `(...)`, whether the drawer has been open by 0.3 m or more after some step.
      total_steps: `(...)`, control steps so far, over all episodes.
    """

    features: Array
    observation: NDArray[np.float32]
    noisy_observation: NDArray[np.float32]
    noise: Array
    target: Array
    previous_action: Array
    terms: dict[str, Array]
    terminates: NDArray[np.bool_]
    succeeded: NDArray[np.bool_]
    total_steps: NDArray[np.int64]

    @property
    def drawer_position(self) -> Array:
        """`(...)`, opening of the drawer [m]."""
        return scalars(self.features[..., FEATURE_INDICES["drawer_position"]])

    @property
    def is_success(self) -> NDArray[np.bool_]:
        """`(...)`, whether the drawer is open by 0.3 m or more now."""
        return succeeds(self.drawer_position)


class OpenCabinetTransition(Transition[OpenCabinetState]):
    """A control step in front of the cabinet.

    Attributes:
      features: after the step.
      handle_radius: radius of the bar of the cabinet's handles [m].
    """

    features: Features
    handle_radius: float

    @functools.cached_property
    def grip(self) -> Grip:
        """Pose of the bar relative to the finger pads after the step."""
        return grip(self.features, self.handle_radius)

    @property
    def gripper(self) -> Array:
        """`(...)`, target of the fingers during the step [m]."""
        return scalars(self.target[..., 7])


@dataclasses.dataclass(frozen=True, kw_only=True)
class OpenCabinetMDP(MDP[Array, OpenCabinetState]):
    """Settings of an open_cabinet task, and the mathematics of an episode under them; see `MDP` for those of all tasks.

    Attributes:
      action_size: number of elements of the action.
      noise_scale: `(25,)`, greatest noise of each element of the observation, in its unit.
      handle_radius: radius of the bar of the cabinet's handles [m].
    """

    sensors: OpenCabinetSensors
    rewards: Mapping[str, RewardTerm[OpenCabinetTransition]]
    action_size: int
    noise_scale: Array
    handle_radius: float

    # The weights of the penalties depend on the control steps of all episodes.
    persistent = ("total_steps",)

    @property
    def noise_draws(self) -> int:
        return SIZE if self.is_noisy else 0

    @functools.cached_property
    def is_noisy(self) -> bool:
        """Whether the observation has noise."""
        return bool(self.noise_scale.any())

    def initial_state(self, reading: Array, draws: Array) -> OpenCabinetState:
        axes = reading.shape[:-1]
        view = Features(reading)
        noise = self.noise_scale * draws if self.is_noisy else np.zeros((*axes, SIZE))
        clean, noisy = self.observed(view, noise)
        return OpenCabinetState(
            features=reading,
            observation=clean,
            noisy_observation=noisy,
            noise=noise,
            target=view.joint_positions.copy(),
            previous_action=np.zeros((*axes, self.action_size)),
            terms=self.no_reward(axes),
            terminates=np.zeros(axes, bool),
            succeeded=np.zeros(axes, bool),
            total_steps=np.zeros(axes, np.int64),
        )

    def observed(self, features: Features, noise: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns the observation without and with its noise `(..., 25)`, as a state holds them.

        Noise is added before clipping, so that noisy observations keep the range.
        """
        values = observe(features)
        clean = clipped(values)
        noisy = clipped(values + noise) if self.is_noisy else clean
        return clean, noisy

    def transition(
        self, state: OpenCabinetState, *, action: Array, target: Array, reading: Array, draws: Array
    ) -> OpenCabinetTransition:
        view = Features(reading)
        noise = self.noise_scale * draws if self.is_noisy else state.noise
        clean, noisy = self.observed(view, noise)
        after = OpenCabinetState(
            features=reading,
            observation=clean,
            noisy_observation=noisy,
            noise=noise,
            target=target,
            previous_action=action,
            terms={},
            terminates=terminates(view),
            succeeded=state.succeeded | succeeds(view.drawer_position),
            total_steps=state.total_steps + 1,
        )
        step = OpenCabinetTransition(state, action, target, after)
        step.features = view
        step.handle_radius = self.handle_radius
        return step

    @functools.cached_property
    def observations(self) -> Mapping[str, Observation]:
        return {
            key: Observation(self._part(place), of_robot=key in ROBOT_KEYS, minimum=-LIMIT, maximum=LIMIT)
            for key, place in SLICES.items()
        }

    @functools.cached_property
    def noisy_observations(self) -> Mapping[str, slice]:
        """Places of the parts that have noise."""
        return {key: place for key, place in SLICES.items() if self.noise_scale[place].any()}

    @staticmethod
    def _part(place: slice) -> Callable[[Simulation, Any], NDArray[np.float32]]:
        """Returns the function that reads the part at a place."""
        return lambda simulation, state: state.observation[..., place]

    def corrupted(self, key: str, clean: NDArray, state: OpenCabinetState) -> NDArray:
        place = self.noisy_observations.get(key)
        return clean if place is None else state.noisy_observation[..., place]

    def requested_joints(self, scene: Scene, state: OpenCabinetState) -> tuple[mjcf.Element, ...]:
        return (self.sensors.slide,)

    def terminates(self, state: OpenCabinetState) -> NDArray[np.bool_]:
        return state.terminates

    def info(self, state: OpenCabinetState) -> dict[str, NDArray]:
        """Returns the infos on drawer and reward: fresh arrays `(...)`."""
        opening = state.drawer_position
        return {
            **self.reward_info(state),
            "drawer_opening": np.array(opening),
            "is_success": np.array(succeeds(opening)),
            "success_at_any_time": np.array(state.succeeded),
        }

"""The open_cabinet domain's Markov decision process: action to actuator targets, and the state after a control step.

The functions know neither physics nor time. A task keeps the state of one episode; a vectorised environment that of
many, in arrays with one more axis. Both call the same MDP.
"""

import dataclasses
import functools
import operator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.open_cabinet.action import JOINT_LOW, arm_target, gripper_target
from kitchen_suite.tasks.open_cabinet.features import Features, scalars
from kitchen_suite.tasks.open_cabinet.observation import SIZE, observe
from kitchen_suite.tasks.open_cabinet.reward import TERMS, RewardTerms, succeeds, terminates

PHYSICS_TIMESTEP = 0.005  # [s]
CONTROL_TIMESTEP = 0.01  # [s]
GRIPPER_MODES = ("sampled", "deterministic")
ACTION_SIZE = JOINT_LOW.size


class OpenCabinetState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      features: `(..., 36)`, values of the present `Features`.
      observation: `(..., 25)`, the observation without noise, not yet clipped.
      noise: `(..., 25)`, noise of the observation.
      previous_action: `(..., 8)`, action of the last step.
      terms: `(...)` each, the terms of the last step's reward by name.
      terminates: `(...)`, whether the last step terminated the episode.
      succeeded: `(...)`, whether the drawer has been open by 0.3 m or more after some step.
    """

    features: NDArray[np.float64]
    observation: NDArray[np.float64]
    noise: NDArray[np.float64]
    previous_action: NDArray[np.float64]
    terms: dict[str, NDArray[np.float64]]
    terminates: NDArray[np.bool_]
    succeeded: NDArray[np.bool_]

    @property
    def reward(self) -> NDArray[np.float64]:
        """`(...)`, reward of the last step."""
        return functools.reduce(operator.add, self.terms.values())

    @property
    def is_success(self) -> NDArray[np.bool_]:
        """`(...)`, whether the drawer is open by 0.3 m or more now."""
        return succeeds(Features(self.features).drawer_position)


@dataclasses.dataclass(frozen=True, kw_only=True)
class OpenCabinetMDP:
    """Settings of an open_cabinet task, and the mathematics of an episode under them.

    Attributes:
      samples_gripper: whether closing is sampled with the probability of the gripper logit, or decided by its sign.
      noise_scale: `(25,)`, greatest noise of each element of the observation, in its unit.
      reward_terms: reward function of a step.
    """

    samples_gripper: bool
    noise_scale: NDArray[np.float64]
    reward_terms: RewardTerms

    @functools.cached_property
    def is_noisy(self) -> bool:
        """Whether the observation has noise; otherwise none is drawn."""
        return bool(self.noise_scale.any())

    def draw_noise(self, random_state: np.random.RandomState) -> NDArray[np.float64]:
        """Returns noise `(25,)` for a control step; draws nothing if there is none."""
        return self.noise_scale * random_state.uniform(-1.0, 1.0, SIZE) if self.is_noisy else np.zeros(SIZE)

    def draw_gripper(self, random_state: np.random.RandomState) -> float:
        """Returns a draw from U(0, 1) for `gripper_target` if the gripper is sampled, otherwise the median 0.5."""
        return random_state.random_sample() if self.samples_gripper else 0.5

    def initial_state(self, features: NDArray[np.float64], noise: NDArray[np.float64]) -> OpenCabinetState:
        """Returns the state before the first step; arguments as the attributes of `OpenCabinetState`."""
        axes = features.shape[:-1]
        return OpenCabinetState(
            features=features,
            observation=observe(Features(features)),
            noise=noise,
            previous_action=np.zeros((*axes, ACTION_SIZE)),
            terms=dict.fromkeys(TERMS, np.zeros(axes)),
            terminates=np.zeros(axes, bool),
            succeeded=np.zeros(axes, bool),
        )

    def compute_control(
        self, positions: NDArray[np.float64], action: NDArray[np.float64], draw: NDArray[np.float64] | float
    ) -> NDArray[np.float64]:
        """Returns targets `(..., 9)` of the robot's actuators [rad, m].

        Args:
          positions: `(..., 9)`, present positions of its joints [rad, m].
          action: `(..., 8)`, seven joint offsets [rad] and the gripper logit.
          draw: `(...)`, from `draw_gripper`.
        """
        target = np.empty(positions.shape)
        target[..., :7] = arm_target(positions[..., :7], action[..., :7])
        target[..., 7:] = gripper_target(action[..., 7:], np.asarray(draw)[..., np.newaxis])
        return target

    def step(
        self,
        state: OpenCabinetState,
        *,
        action: NDArray[np.float64],
        target: NDArray[np.float64],
        total_steps: NDArray[np.int64] | int,
        features: NDArray[np.float64],
        noise: NDArray[np.float64],
    ) -> OpenCabinetState:
        """Returns the state after one more control step.

        Args:
          state: the state before it.
          action: `(..., 8)`, its action.
          target: `(..., 9)`, targets of the actuators during it [rad, m].
          total_steps: `(...)`, control steps of the task before it, over all episodes.
          features: `(..., 36)`, values of the `Features` after it.
          noise: `(..., 25)`, noise of the observation after it.
        """
        after = Features(features)
        # The change may be infinite; the reward bounds it.
        with np.errstate(over="ignore"):
            change = action - state.previous_action
        terminated = terminates(after)
        terms = self.reward_terms(
            after,
            gripper=scalars(target[..., 7]),
            action_change=change,
            total_steps=total_steps,
            terminated=terminated,
        )
        return OpenCabinetState(
            features=features,
            observation=observe(after),
            noise=noise,
            previous_action=action,
            terms=terms,
            terminates=terminated,
            succeeded=state.succeeded | succeeds(after.drawer_position),
        )

    def info(self, state: OpenCabinetState) -> dict[str, NDArray]:
        """Returns the part of the infos that reports on drawer and reward: fresh arrays `(...)`."""
        return {
            **{f"reward/{name}": np.array(term) for name, term in state.terms.items()},
            "drawer_opening": np.array(Features(state.features).drawer_position),
            "is_success": np.array(state.is_success),
            "success_at_any_time": np.array(state.succeeded),
        }

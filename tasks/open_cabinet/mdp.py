"""The open_cabinet domain's rules: what an action commands, and what a control step adds to an episode.

Nothing here knows of physics or of time gone by: a task holds the state of one episode, a vectorised environment that
of many, in arrays with one more axis, and both ask the same rules.
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
from kitchen_suite.tasks.open_cabinet.reward import TERMS, RewardTerms, succeeds

PHYSICS_TIMESTEP = 0.005  # [s]
CONTROL_TIMESTEP = 0.01  # [s]
GRIPPER_MODES = ("sampled", "deterministic")
ACTION_SIZE = JOINT_LOW.size


class OpenCabinetState(NamedTuple):
    """What an episode remembers from one control step to the next.

    Attributes:
      features: `(..., 36)`, numbers of the present `Features`.
      observation: `(..., 25)`, what is seen of it, without noise and not yet clipped.
      noise: `(..., 25)`, what is added to that.
      previous_action: `(..., 8)`.
      terms: `(...)` each, the terms of the last step's reward by name.
      terminates: `(...)`, whether the last step ended the episode.
      succeeded: `(...)`, whether the drawer has been open far enough after some step.
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
        """`(...)`, whether the drawer is open far enough now."""
        return succeeds(Features(self.features).drawer_position)


@dataclasses.dataclass(frozen=True, kw_only=True)
class OpenCabinetMDP:
    """A drawer task's settings, and the mathematics of an episode under them.

    Attributes:
      samples_gripper: whether a draw decides on closing, or the sign of the action.
      noise_scale: `(25,)`, greatest noise of each number of the observation, in its unit.
      reward_terms: what gives the terms of a step's reward.
    """

    samples_gripper: bool
    noise_scale: NDArray[np.float64]
    reward_terms: RewardTerms

    @functools.cached_property
    def is_noisy(self) -> bool:
        """Whether there is any noise; where there is none, none is drawn."""
        return bool(self.noise_scale.any())

    def draw_noise(self, random_state: np.random.RandomState) -> NDArray[np.float64]:
        """Draws the noise `(25,)` of a control step."""
        return self.noise_scale * random_state.uniform(-1.0, 1.0, SIZE) if self.is_noisy else np.zeros(SIZE)

    def draw_gripper(self, random_state: np.random.RandomState) -> float:
        """Draws from U(0, 1) what decides on closing; where nothing is to be drawn, the median."""
        return random_state.random_sample() if self.samples_gripper else 0.5

    def initial_state(self, features: NDArray[np.float64], noise: NDArray[np.float64]) -> OpenCabinetState:
        """The state before the first step; arguments as attributes of `OpenCabinetState`."""
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
        """Targets `(..., 9)` of the robot's servos [rad, m].

        Args:
          positions: `(..., 9)`, where its joints are [rad, m].
          action: `(..., 8)`.
          draw: `(...)`, what decides on closing.
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
        """The state after one more control step.

        Args:
          state: the one before it.
          action: `(..., 8)`.
          target: `(..., 9)`, what was commanded [rad, m].
          total_steps: `(...)`, control steps of the environment's life before it.
          features: `(..., 36)`, what came of it.
          noise: `(..., 25)`, of the observation after it.
        """
        after = Features(features)
        # It may be infinite; the reward bounds it.
        with np.errstate(over="ignore"):
            change = action - state.previous_action
        gripper = scalars(target[..., 7])
        terms = self.reward_terms(after, gripper=gripper, action_change=change, total_steps=total_steps)
        succeeded = state.succeeded | succeeds(after.drawer_position)
        return OpenCabinetState(
            features=features,
            observation=observe(after),
            noise=noise,
            previous_action=action,
            terms=terms,
            # The term is negative where the step terminates.
            terminates=terms["termination"] < 0.0,
            succeeded=succeeded,
        )

"""Controllers, which choose the actions of vectorised environments: one policy for each, or one network for all."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import dm_env
import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies import Policy, PolicyBuilder, PolicyError
from kitchen_suite.rollouts.spec import policy_generator
from kitchen_suite.vector_env.base import SuiteVectorEnv


class BatchStep(NamedTuple):
    """Observations and rewards of all environments after a step or a reset.

    Attributes:
      observations: of the vectorised observation space.
      rewards: `(n,)`, of the last step.
      is_first: `(n,)`, whether the last call was a reset.
      is_playing: `(n,)`, whether an episode is in progress; elsewhere observations and actions mean nothing.
    """

    observations: Any
    rewards: NDArray[np.float64]
    is_first: NDArray[np.bool_]
    is_playing: NDArray[np.bool_]


class Controller(Protocol):
    """Chooses the actions of all environments."""

    def start(self, i: int, seed: int) -> None:
        """Prepares for an episode of a seed in environment `i`."""

    def act(self, step: BatchStep) -> NDArray:
        """Returns the actions `(n, ...)`."""


class PolicyController:
    """Acts by a policy of its own in each environment, on time steps as the suite's own environment returns them."""

    def __init__(self, environments: SuiteVectorEnv, build_policy: PolicyBuilder) -> None:
        """Prepares to build policies.

        Args:
          environments: in which they act.
          build_policy: builds the policy of an episode.
        """
        self._environments, self._build_policy = environments, build_policy
        assert isinstance(environments.single_action_space, gymnasium.spaces.Box)
        self._space = environments.single_action_space
        self._policies: dict[int, Policy] = {}

    def start(self, i: int, seed: int) -> None:
        self._policies[i] = self._build_policy(self._environments.template_env.environment, policy_generator(seed))

    def act(self, step: BatchStep) -> NDArray:
        actions = np.zeros((step.rewards.size, *self._space.shape), self._space.dtype)
        # Policies act on the time steps of dm_env, in rollouts as in recordings.
        observations = self._environments.suite_observations()
        for i in np.flatnonzero(step.is_playing).tolist():
            actions[i] = self._action(i, step, {key: array[i] for key, array in observations.items()})
        return actions

    def _action(self, i: int, step: BatchStep, observation: dict[str, NDArray]) -> NDArray:
        timestep = dm_env.restart(observation) if step.is_first[i] else dm_env.transition(step.rewards[i], observation)
        # Clipped here, so that the recorded action is the applied one.
        action = np.asarray(self._policies[i](timestep)).clip(self._space.low, self._space.high)
        if np.abs(action).max() > np.finfo(self._space.dtype).max:
            raise PolicyError(f"the policy's action does not fit into {self._space.dtype}: {action}")
        return action


class NetworkController:
    """Acts by a function of the observations of all environments at once."""

    def __init__(self, network: Callable[[Any], NDArray]) -> None:
        """Takes a function from vectorised observations to actions `(n, ...)`."""
        self._network = network

    def start(self, i: int, seed: int) -> None:
        del i, seed

    def act(self, step: BatchStep) -> NDArray:
        return self._network(step.observations)

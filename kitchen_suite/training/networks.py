"""Networks of the agent: a Gaussian policy with correlated exploration noise, and a value function."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from gymnasium import spaces
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model

from kitchen_suite.training.hyperparameters import Hyperparameters

# The simulation runs on the CPU, too. skrl's default is a GPU if there is one.
DEVICE = "cpu"

# Factor of the initial weights of the policy's last layer: its first actions are almost pure exploration noise.
_LAST_LAYER_SCALE = 0.01


class Policy(GaussianMixin, Model):
    """Gaussian policy: the mean is computed by a network, the standard deviations do not depend on the observation.

    Both are in units of `scale`, so that an optimiser step has the same effect on every action, whether it is an angle
    or a gripper logit.

    Exploration noise is an AR(1) process over control steps, so that it adds up to motions instead of averaging out;
    the PPO ratio treats the steps as independent. Source of the idea: Hollenstein et al., Colored Noise in PPO,
    AAAI 2024.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        action_space: spaces.Box,
        scale: torch.Tensor,
        config: Hyperparameters,
    ) -> None:
        """Builds the network.

        Args:
          observation_space: `(n,)`.
          action_space: `(k,)`.
          scale: action `(k,)` for network outputs of one.
          config: hyperparameters of the hidden layers and of exploration.
        """
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=DEVICE)
        GaussianMixin.__init__(self, clip_actions=False)
        self.network = build_network([self.num_observations, *config.hidden, self.num_actions])
        self.log_deviation = torch.nn.Parameter(torch.full((self.num_actions,), math.log(config.exploration)))
        self._noise = CorrelatedNoise(config.noise_correlation)
        self.register_buffer("scale", scale)
        last_layer = self.network[-1]
        assert isinstance(last_layer, torch.nn.Linear)
        with torch.no_grad():
            last_layer.weight.mul_(_LAST_LAYER_SCALE)
            last_layer.bias.zero_()

    def act(self, inputs: dict[str, Any], *, role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        """Returns actions `(n, k)` with exploration, and PPO's outputs for them, such as their log probability.

        If `inputs` has `taken_actions`, the outputs are those of these actions, and the noise does not advance.
        """
        actions, outputs = super().act(inputs, role=role)
        if "taken_actions" in inputs:
            return actions, outputs
        distribution = self.distribution(role=role)
        actions = distribution.mean + distribution.stddev * self._noise(actions.shape)
        outputs["log_prob"] = distribution.log_prob(actions).sum(dim=-1, keepdim=True)
        return actions, outputs

    def compute(self, inputs: Mapping[str, Any], role: str) -> tuple[torch.Tensor, dict[str, Any]]:
        """Returns the means `(n, k)` and the logarithms of the standard deviations `(k,)`."""
        del role
        means = self.network(inputs["observations"]) * self.scale
        return means, {"log_std": self.log_deviation + self.scale.log()}


class CorrelatedNoise:
    """Stationary AR(1) process with a standard normal distribution: `x' = c x + sqrt(1 - c^2) w`, `w ~ N(0, 1)`."""

    def __init__(self, correlation: float) -> None:
        """Creates the process; `correlation` of successive samples is in [0, 1)."""
        self._correlation = correlation
        self._last = torch.empty(0)

    def __call__(self, shape: torch.Size) -> torch.Tensor:
        """Returns the next sample; the process restarts if its shape changes."""
        noise = torch.randn(shape)
        if self._last.shape == shape:
            noise = self._correlation * self._last + math.sqrt(1 - self._correlation**2) * noise
        self._last = noise
        return noise


class Value(DeterministicMixin, Model):
    """Value function: expected return of an observation."""

    def __init__(self, observation_space: spaces.Box, action_space: spaces.Box, hidden: Sequence[int]) -> None:
        """Builds the network with the given sizes of hidden layers."""
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=DEVICE)
        DeterministicMixin.__init__(self)
        self.network = build_network([self.num_observations, *hidden, 1])

    def compute(self, inputs: Mapping[str, Any], role: str) -> tuple[torch.Tensor, dict[str, Any]]:
        """Returns the values `(n, 1)`."""
        del role
        return self.network(inputs["observations"]), {}


def build_network(sizes: Sequence[int]) -> torch.nn.Sequential:
    """Returns a multilayer perceptron with ELU units between its linear layers, of the given sizes."""
    layers: list[torch.nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [torch.nn.Linear(inputs, outputs), torch.nn.ELU()]
    return torch.nn.Sequential(*layers[:-1])

"""The networks of an agent: what acts, with exploration, and what return it expects."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from gymnasium import spaces
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model

from kitchen_suite.training.hyperparameters import Hyperparameters

# Where the simulation is, too. By itself skrl takes a GPU where it finds one.
DEVICE = "cpu"

# The last layer starts this small, so that the first actions are exploration alone.
_LAST_LAYER = 0.01


class Policy(GaussianMixin, Model):
    """Actions are normally distributed around a network's outputs; their deviations do not depend on what is seen.

    Outputs and deviations are in units of `scale`, so that a step of the optimiser means the same for every action,
    be it an angle or the log odds of closing the gripper. What is played keeps part of its deviation from one control
    step to the next, so that exploration gets somewhere; PPO takes it as if it did not, as with the coloured noise of
    Hollenstein et al., Colored Noise in PPO, AAAI 2024.
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
          scale: `(k,)`.
          config: of hidden layers and of exploration.
        """
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=DEVICE)
        GaussianMixin.__init__(self, clip_actions=False)
        self.network = network([self.num_observations, *config.hidden, self.num_actions])
        self.log_deviation = torch.nn.Parameter(torch.full((self.num_actions,), math.log(config.exploration)))
        self._noise = CorrelatedNoise(config.noise_correlation)
        self.register_buffer("scale", scale)
        with torch.no_grad():
            self.network[-1].weight *= _LAST_LAYER
            self.network[-1].bias.zero_()

    def act(self, inputs: dict[str, Any], *, role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        """Actions to play, `(n, k)`, and what PPO wants to know of them, or of the `taken_actions` in `inputs`."""
        actions, outputs = super().act(inputs, role=role)
        if "taken_actions" in inputs:
            return actions, outputs
        distribution = self.distribution(role=role)
        actions = distribution.mean + distribution.stddev * self._noise(actions.shape)
        outputs["log_prob"] = distribution.log_prob(actions).sum(dim=-1, keepdim=True)
        return actions, outputs

    def compute(self, inputs: Mapping[str, Any], role: str) -> tuple[torch.Tensor, dict[str, Any]]:
        """Means `(n, k)` and logarithms of the deviations."""
        del role
        means = self.network(inputs["observations"]) * self.scale
        return means, {"log_std": self.log_deviation + self.scale.log()}


class CorrelatedNoise:
    """Standard normal numbers, each correlated with its like of the call before (an AR(1) process)."""

    def __init__(self, correlation: float) -> None:
        """Begins at random; `correlation` is in [0, 1)."""
        self._correlation = correlation
        self._last = torch.empty(0)

    def __call__(self, shape: torch.Size) -> torch.Tensor:
        """The next numbers; they begin anew where the shape is another."""
        noise = torch.randn(shape)
        if self._last.shape == shape:
            noise = self._correlation * self._last + math.sqrt(1 - self._correlation**2) * noise
        self._last = noise
        return noise


class Value(DeterministicMixin, Model):
    """What return a network expects."""

    def __init__(self, observation_space: spaces.Box, action_space: spaces.Box, hidden: Sequence[int]) -> None:
        """Builds the network."""
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=DEVICE)
        DeterministicMixin.__init__(self)
        self.network = network([self.num_observations, *hidden, 1])

    def compute(self, inputs: Mapping[str, Any], role: str) -> tuple[torch.Tensor, dict[str, Any]]:
        """Values `(n, 1)`."""
        del role
        return self.network(inputs["observations"]), {}


def network(sizes: Sequence[int]) -> torch.nn.Sequential:
    """A perceptron with ELU units between its layers."""
    layers: list[torch.nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [torch.nn.Linear(inputs, outputs), torch.nn.ELU()]
    return torch.nn.Sequential(*layers[:-1])

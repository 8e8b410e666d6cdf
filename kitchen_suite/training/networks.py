"""Networks of the agent: a Gaussian policy with correlated exploration noise, and a value function."""

import itertools
import math
from collections.abc import Sequence

import torch

from kitchen_suite.policies.networks import CLIP
from kitchen_suite.training.hyperparameters import Hyperparameters

# Factor of the initial weights of the policy's last layer: its first actions are almost pure exploration noise.
_LAST_LAYER_SCALE = 0.01

# Number of vectors that a frozen scaler counts as seen, so large that later ones do not change its statistics.
_FROZEN_COUNT = 1e15


class GaussianPolicy(torch.nn.Module):
    """Gaussian policy: the mean is computed by a network, the standard deviations do not depend on the observation.

    Both, and the actions that it deals with, are in units of `scale`, so that an optimiser step has the same effect on
    every element of the action, whether it is an angle or a gripper logit.

    Exploration noise is an AR(1) process over control steps, so that it adds up to motions instead of averaging out;
    the PPO ratio treats the steps as independent. Source of the idea: Hollenstein et al., Colored Noise in PPO,
    AAAI 2024.

    Attributes:
      network: from standardised observations `(n, m)` to the means `(n, k)`.
      log_deviation: `(k,)`, logarithms of the standard deviations.
      noise: of exploration.
      scale: `(k,)`, action for network outputs of one.
    """

    scale: torch.Tensor

    def __init__(self, observation_size: int, scale: torch.Tensor, config: Hyperparameters) -> None:
        """Builds the network.

        Args:
          observation_size: number of elements of an observation.
          scale: `(k,)`, action for network outputs of one.
          config: hyperparameters of the hidden layers and of exploration.
        """
        super().__init__()
        self.network = build_network([observation_size, *config.hidden, scale.numel()])
        self.log_deviation = torch.nn.Parameter(torch.full(scale.shape, math.log(config.exploration)))
        self.noise = CorrelatedNoise(config.noise_correlation)
        self.register_buffer("scale", scale)
        last_layer = self.network[-1]
        assert isinstance(last_layer, torch.nn.Linear)
        with torch.no_grad():
            last_layer.weight.mul_(_LAST_LAYER_SCALE)
            last_layer.bias.zero_()

    @torch.no_grad()
    def explore(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Returns actions `(n, k)` with exploration, and the logarithms `(n,)` of their densities."""
        means = self.network(observations)
        noise = self.noise(means.shape)
        return means + self.log_deviation.exp() * noise, self._log_density(noise)

    def log_densities(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Returns the logarithms `(n,)` of the densities of actions `(n, k)`, without the constant of the normal."""
        return self._log_density((actions - self.network(observations)) / self.log_deviation.exp())

    def _log_density(self, noise: torch.Tensor) -> torch.Tensor:
        """Returns the logarithms `(n,)` of densities from standardised deviations `(n, k)` from the means."""
        return -0.5 * noise.square().sum(dim=-1) - self.log_deviation.sum()


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


def build_network(sizes: Sequence[int]) -> torch.nn.Sequential:
    """Returns a multilayer perceptron with ELU units between its linear layers, of the given sizes."""
    layers: list[torch.nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [torch.nn.Linear(inputs, outputs), torch.nn.ELU()]
    return torch.nn.Sequential(*layers[:-1])


class RunningScaler(torch.nn.Module):
    """Standardises vectors, element by element.

    The statistics have 64 bits: with 32, millions of samples would leave later ones without effect.

    Attributes:
      running_mean: `(m,)`.
      running_variance: `(m,)`.
      current_count: `()`, number of vectors seen.
      epsilon: added to the standard deviations.
    """

    running_mean: torch.Tensor
    running_variance: torch.Tensor
    current_count: torch.Tensor

    def __init__(self, size: int, epsilon: float) -> None:
        """Begins with mean 0 and variance 1, which count as one vector."""
        super().__init__()
        self.epsilon = epsilon
        self.register_buffer("running_mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("running_variance", torch.ones(size, dtype=torch.float64))
        self.register_buffer("current_count", torch.ones((), dtype=torch.float64))

    @torch.no_grad()
    def update(self, vectors: torch.Tensor) -> None:
        """Adds vectors `(n, m)`, two or more, to the statistics."""
        variance, mean = torch.var_mean(vectors.double(), dim=0)
        count, total = vectors.shape[0], self.current_count + vectors.shape[0]
        delta = mean - self.running_mean
        squares = self.running_variance * self.current_count + variance * count
        squares += delta.square() * self.current_count * count / total
        self.running_mean += delta * count / total
        self.running_variance.copy_(squares / total)
        self.current_count.copy_(total)

    def freeze(self) -> None:
        """Keeps the statistics as they are, whatever is added later."""
        self.current_count.fill_(_FROZEN_COUNT)

    @property
    def deviation(self) -> torch.Tensor:
        """`(m,)`, divisors of the vectors: standard deviations with the epsilon."""
        return self.running_variance.sqrt() + self.epsilon

    def forward(self, vectors: torch.Tensor) -> torch.Tensor:
        """Returns vectors `(..., m)` standardised, and clipped at `CLIP`."""
        return ((vectors - self.running_mean.float()) / self.deviation.float()).clamp(-CLIP, CLIP)

    def inverse(self, vectors: torch.Tensor) -> torch.Tensor:
        """Returns the vectors `(..., m)` that have been standardised, except for the clipping."""
        return vectors * self.deviation.float() + self.running_mean.float()

"""Standardisation by the running mean and variance of what has been seen."""

import torch

# Bound of standardised numbers.
CLIP = 10.0

# Number of vectors that a frozen scaler counts as seen, so large that later ones do not change its statistics.
_FROZEN_COUNT = 1e15


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
        """`(m,)`, what vectors are divided by: standard deviations with the epsilon."""
        return self.running_variance.sqrt() + self.epsilon

    def forward(self, vectors: torch.Tensor) -> torch.Tensor:
        """Returns vectors `(..., m)` standardised, and clipped at `CLIP`."""
        return ((vectors - self.running_mean.float()) / self.deviation.float()).clamp(-CLIP, CLIP)

    def inverse(self, vectors: torch.Tensor) -> torch.Tensor:
        """Returns the vectors `(..., m)` that have been standardised, except for the clipping."""
        return vectors * self.deviation.float() + self.running_mean.float()

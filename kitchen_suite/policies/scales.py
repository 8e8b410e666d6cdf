"""Standardisation of the inputs and actions of policies that are learned by imitation."""

import dataclasses
from typing import Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.residual_network import checked

# Bound of standardised inputs.
CLIP = 10.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scales:
    """Standardisation of inputs and actions.

    Attributes:
      input_mean: `(m,)`.
      input_deviation: `(m,)`, positive.
      action_mean: `(k,)`.
      action_deviation: `(k,)`, positive.
    """

    input_mean: NDArray[np.float32]
    input_deviation: NDArray[np.float32]
    action_mean: NDArray[np.float32]
    action_deviation: NDArray[np.float32]

    @classmethod
    def take(cls, arrays: dict[str, NDArray]) -> Self:
        """Removes the arrays of the scales from others, and returns the scales; raises a ValueError for bad ones."""
        scales = cls(**{name: checked(arrays.pop(name), name) for name in cls.names() if name in arrays})
        for mean, deviation in (
            (scales.input_mean, scales.input_deviation),
            (scales.action_mean, scales.action_deviation),
        ):
            if mean.ndim != 1 or mean.shape != deviation.shape or not (deviation > 0).all():
                raise ValueError("means and positive deviations must be vectors of the same length")
        return scales

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Returns the names of the arrays."""
        return tuple(field.name for field in dataclasses.fields(cls))

    def inputs(self, inputs: NDArray) -> NDArray[np.float32]:
        """Returns inputs `(..., m)` standardised, and clipped."""
        values = ((inputs - self.input_mean) / self.input_deviation).astype(np.float32)
        return np.clip(values, -CLIP, CLIP)

    def actions(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the actions `(..., k)` whose standardised values are given."""
        return values * self.action_deviation + self.action_mean

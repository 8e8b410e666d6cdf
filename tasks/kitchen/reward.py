"""The kitchen's reward, on arrays of shape `(..., n)`; `compute_reward` of the Gymnasium environment calls it, too."""

import numpy as np
from numpy.typing import NDArray


class SparseReward:
    """One for each task completed in a step.

    Attributes:
      terms: names of the terms, which sum to the reward.
    """

    terms = ("completion",)

    def __call__(self, completions: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
        """Returns the terms `(...)` by name.

        Args:
          completions: `(..., n)`, whether each task was completed in the step.
        """
        return {"completion": np.add.reduce(completions, axis=-1, dtype=np.float64)}

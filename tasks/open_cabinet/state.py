"""State of an episode of open_cabinet."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.open_cabinet.features import Features
from kitchen_suite.tasks.open_cabinet.reward import succeeds
from kitchen_suite.tasks.rewards import total


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
      total_steps: `(...)`, control steps so far, over all episodes.
    """

    features: NDArray[np.float64]
    observation: NDArray[np.float64]
    noise: NDArray[np.float64]
    previous_action: NDArray[np.float64]
    terms: dict[str, NDArray[np.float64]]
    terminates: NDArray[np.bool_]
    succeeded: NDArray[np.bool_]
    total_steps: NDArray[np.int64]

    @property
    def reward(self) -> NDArray[np.float64]:
        """`(...)`, reward of the last step."""
        return total(self.terms)

    @property
    def is_success(self) -> NDArray[np.bool_]:
        """`(...)`, whether the drawer is open by 0.3 m or more now."""
        return succeeds(Features(self.features).drawer_position)

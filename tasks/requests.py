"""Options of a reset: the variation of its episode, and those of the task."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.tasks.variations.variations import VariationRequest

# Options of a reset that tasks with variations have.
VARIATION = "variation"
VARIATION_VALUES = "variation_values"


class Reset(NamedTuple):
    """The checked options of one reset.

    Attributes:
      variation: the parameters that vary, and their values.
      request: what `Requests.checked` returned; None for an episode as the task draws it.
    """

    variation: VariationRequest = VariationRequest()
    request: Any = None


class Requests:
    """Options of a reset that belong to a task; this class has none.

    Attributes:
      options: names of the options.
      drawn_tasks: names of the `n` tasks of which each episode draws some; empty if every episode asks for the same.
      weights: `(n,)`, with which later episodes draw them; only where tasks are drawn.
    """

    options: tuple[str, ...] = ()
    drawn_tasks: tuple[str, ...] = ()
    weights: Any

    def checked(self, options: Mapping[str, Any]) -> Any:
        """Returns the checked request of a reset's options for one episode; None if they have none.

        Raises a TypeError or a ValueError for an option that the task refuses.
        """
        return None

    def draw(self, random_state: np.random.RandomState, request: Any) -> None:
        """Draws what the episode that starts asks for, or discards the draw where a request says so.

        Args:
          random_state: that is drawn from, whatever the request.
          request: what `checked` returned.
        """

    def recorded(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        """Returns the options of a reset that repeat what was drawn in a recorded episode.

        Args:
          arrays: the episode's `observation/...` and `info/...` arrays with a leading axis of `T + 1`.
        """
        return {}

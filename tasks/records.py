"""What is read from the records of episodes: metrics, and completions of tasks."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Verdicts, measures, and the control steps at which goals were completed, by the goals' names.
Metrics = dict[str, bool | float | dict[str, int]]


class Completions(NamedTuple):
    """The tasks of an episode that asks for several.

    Attributes:
      tasks: the names of all `n` tasks.
      requested: `(n,)`, which of them the episode asks for.
      steps: `(n,)`, control step, from 1, at which each was first completed; not positive where it was not.
    """

    tasks: tuple[str, ...]
    requested: NDArray[np.bool_]
    steps: NDArray[np.int64]

    @property
    def steps_by_task(self) -> dict[str, int | None]:
        """The requested tasks, each with the control step of its completion or None."""
        rows = zip(self.tasks, self.requested.tolist(), self.steps.tolist(), strict=True)
        return {name: step if step > 0 else None for name, is_requested, step in rows if is_requested}

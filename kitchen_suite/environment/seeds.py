"""Seeds of successive episodes, where each episode has a seed of its own."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kitchen_suite import checks

NEXT_SEED = "next_seed"
"""Key of the seed of the next episode in states."""

UNKNOWN = -1
"""In place of the seed of the next episode, where no seed has been given."""


class EpisodeSeeds:
    """The seeds of successive episodes of an environment, by its argument `episode_seeds`.

    It is False where all episodes draw from one stream.

    Attributes:
      stride: by how much the seed of each episode exceeds that of the one before; 0 where all draw from one stream.
      next: seed of the next episode, or `UNKNOWN`.
    """

    def __init__(self, episode_seeds: bool | int, true: int = 1) -> None:
        """Begins without a seed.

        Args:
          episode_seeds: False for one stream; True for the stride `true`; or the stride.
          true: the stride that True stands for.

        Raises:
          TypeError: it is no bool and no integer.
          ValueError: it is less than 1.
        """
        if isinstance(episode_seeds, bool | np.bool_):
            self.stride = true if episode_seeds else 0
        else:
            self.stride = checks.integer(episode_seeds, "episode_seeds", minimum=1)
        self.next = UNKNOWN

    def __bool__(self) -> bool:
        return self.stride > 0

    def after(self, seed: int) -> int:
        """Returns the seed of the episode after that of a seed, or `UNKNOWN`."""
        return seed + self.stride if self and seed != UNKNOWN else UNKNOWN

    def known(self) -> int:
        """Returns the seed of the next episode; raises a ValueError if it is `UNKNOWN`."""
        if self.next == UNKNOWN:
            raise ValueError(
                "episode_seeds counts from a seed, but a random stream was assigned in place of one: give a seed to "
                "reset, or set random_state to an int"
            )
        return self.next

    @property
    def current(self) -> int:
        """Seed of the present episode, or `UNKNOWN`."""
        return UNKNOWN if self.next == UNKNOWN else self.next - self.stride

    def saved(self) -> dict[str, int]:
        """Returns what states hold of the seeds; nothing where all episodes draw from one stream."""
        return {NEXT_SEED: self.next} if self else {}

    def checked(self, state: Mapping[str, Any]) -> int:
        """Returns the seed of the next episode in a state; `UNKNOWN` where all episodes draw from one stream."""
        if not self:
            return UNKNOWN
        if NEXT_SEED not in state:
            raise ValueError(f"state[{NEXT_SEED!r}] is missing: the state is of an environment without episode_seeds")
        return checks.integer(state[NEXT_SEED], f"state[{NEXT_SEED!r}]", minimum=UNKNOWN)

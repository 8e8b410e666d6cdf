"""Seeds of successive episodes, where each episode has a seed of its own."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kitchen_suite import checks

NEXT_SEED = "next_seed"
"""Key of the seed of the next episode in states."""

UNKNOWN = -1
"""In place of the seed of the next episode, where no seed has been given."""


def checked_stride(episode_seeds: bool | int, true: int = 1) -> int:
    """Returns by how much the seed of each episode exceeds that of the one before; 0 where all draw from one stream.

    Args:
      episode_seeds: False for one stream; True for the stride `true`; or the stride.
      true: the stride that True stands for.

    Raises:
      TypeError: it is no bool and no integer.
      ValueError: it is less than 1.
    """
    if isinstance(episode_seeds, bool | np.bool_):
        return true if episode_seeds else 0
    return checks.integer(episode_seeds, "episode_seeds", minimum=1)


def checked_next_seed(state: Mapping[str, Any]) -> int:
    """Returns the seed of the next episode in a state of an environment with `episode_seeds`."""
    if NEXT_SEED not in state:
        raise ValueError(f"state[{NEXT_SEED!r}] is missing: the state is of an environment without episode_seeds")
    return checks.integer(state[NEXT_SEED], f"state[{NEXT_SEED!r}]", minimum=UNKNOWN)


def known(next_seed: int) -> int:
    """Returns the seed of the next episode; raises a ValueError if it is `UNKNOWN`."""
    if next_seed == UNKNOWN:
        raise ValueError(
            "episode_seeds counts from a seed, but a random stream was assigned in place of one: give a seed to reset, "
            "or set random_state to an int"
        )
    return next_seed

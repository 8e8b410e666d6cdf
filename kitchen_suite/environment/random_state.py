"""Random states: from what callers pass as a seed, and back from what they stored."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np


def make_random_state(random: int | np.random.RandomState | None) -> np.random.RandomState:
    """Returns a RandomState for what dm_control's pipelines pass as `random`.

    Args:
      random: a state, which is used as it is; a seed, whose bits above the 32nd are folded onto the lower ones; or
        `None` for fresh entropy.

    Raises:
      TypeError: it is something else.
      ValueError: the seed is negative.
    """
    if random is None or isinstance(random, np.random.RandomState):
        return random or np.random.RandomState()
    if isinstance(random, bool) or not isinstance(random, int | np.integer):
        raise TypeError(f"random must be an int, a numpy RandomState or None, got {random!r}")
    if random < 0:
        raise ValueError(f"random must not be negative, got {random}")
    seed, folded = int(random), 0
    while seed:
        folded ^= seed & 0xFFFFFFFF
        seed >>= 32
    return np.random.RandomState(folded)


def check_stored(stored: object, random_state: np.random.RandomState) -> dict[str, Any]:
    """Returns what `random_state.get_state(legacy=False)` once gave, if `random_state` can take it up again.

    Raises:
      TypeError: it is no dict.
      ValueError: it is of another bit generator, or broken.
    """
    if not isinstance(stored, Mapping):
        raise TypeError(f"state['random'] must be a dict, got {stored!r}")
    generator = random_state.get_state(legacy=False)["bit_generator"]
    if stored.get("bit_generator") != generator:
        raise ValueError(f"state['random'] must be of a {generator}, got one of {stored.get('bit_generator')!r}")
    try:
        np.random.RandomState(getattr(np.random, generator)()).set_state(dict(stored))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"state['random'] cannot be taken up by a {generator}: {error!r}") from error
    return dict(stored)


class Stream:
    """The random stream of one environment, as Gymnasium and as composer see it.

    Attributes:
      generator: what Gymnasium makes of the seed.
      seed: drawn by Gymnasium when `None` is given.
      random_state: draws the generator's numbers.
      sample: draws one of them from U(0, 1).
    """

    def __init__(self, seed: int | None) -> None:
        """Starts the stream."""
        self.generator, self.seed = gymnasium.utils.seeding.np_random(seed)
        self.random_state = np.random.RandomState(self.generator.bit_generator)
        self.sample = self.random_state.random_sample

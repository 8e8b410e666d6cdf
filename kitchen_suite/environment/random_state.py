"""Random states: built from seeds, restored from stored states, shared with Gymnasium's generators."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np


def make_random_state(random: int | np.random.RandomState | None) -> np.random.RandomState:
    """Returns a RandomState for the argument `random` of dm_control's environments.

    Args:
      random: a RandomState, which is returned as it is; a seed of any size, whose bits above the 32nd are folded onto
        the lower ones; or `None` for fresh entropy.

    Raises:
      TypeError: `random` has another type.
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


def legacy_generator(seed: int | None) -> np.random.Generator:
    """Returns a generator from whose bit generator a RandomState draws the numbers of `make_random_state(seed)`."""
    bit_generator = np.random.MT19937()
    np.random.RandomState(bit_generator).set_state(make_random_state(seed).get_state(legacy=False))
    return np.random.Generator(bit_generator)


def check_stored(stored: object, random_state: np.random.RandomState) -> dict[str, Any]:
    """Returns a stored result of `random_state.get_state(legacy=False)`, if `random_state` can be set to it.

    Raises:
      TypeError: it is no dict.
      ValueError: it belongs to another bit generator, or is broken.
    """
    if not isinstance(stored, Mapping):
        raise TypeError(f"state['random'] must be a dict, got {stored!r}")
    generator = random_state.get_state(legacy=False)["bit_generator"]
    if stored.get("bit_generator") != generator:
        raise ValueError(f"state['random'] must be of a {generator}, got one of {stored.get('bit_generator')!r}")
    try:
        np.random.RandomState(getattr(np.random, generator)()).set_state(dict(stored))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"state['random'] is no state of a {generator}: {error!r}") from error
    return dict(stored)


class Stream:
    """The random stream of one environment, drawn from by Gymnasium and by composer.

    Attributes:
      generator: Gymnasium's generator for the seed.
      seed: the seed; drawn by Gymnasium when `None` is passed.
      random_state: a RandomState over the generator's bit generator.
    """

    def __init__(self, seed: int | None) -> None:
        """Starts the stream."""
        self.generator, self.seed = gymnasium.utils.seeding.np_random(seed)
        self.random_state = np.random.RandomState(self.generator.bit_generator)

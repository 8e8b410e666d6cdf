"""Random states of environments: made from seeds, and checked in saved states."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kitchen_suite import checks


def make_random_state(random: int | np.random.RandomState | None) -> np.random.RandomState:
    """Returns a RandomState for the argument `random` of dm_control's environments.

    Args:
      random: a RandomState, which is returned as it is; a seed of any size, whose bits above the 32nd are folded onto
        the lower ones; or `None` for fresh entropy.
    """
    if random is None or isinstance(random, np.random.RandomState):
        return random or np.random.RandomState()
    if isinstance(random, bool) or not isinstance(random, int | np.integer):
        raise TypeError(f"random must be an int, a numpy RandomState or None, got {checks.shown(random)}")
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


def first_seed(random: int | np.random.RandomState | None) -> int:
    """Returns the seed of the first episode; a TypeError for a RandomState, and a drawn one for None."""
    if random is None:
        return int(np.random.default_rng().integers(2**32))
    if isinstance(random, np.random.RandomState):
        raise TypeError("episode_seeds counts from a seed: random must be an int or None, got a RandomState")
    make_random_state(random)
    return int(random)


def checked_random(stored: object, random_state: np.random.RandomState) -> dict[str, Any]:
    """Returns a stored result of `random_state.get_state(legacy=False)`, if `random_state` can be set to it."""
    if not isinstance(stored, Mapping):
        raise TypeError(f"state['random'] must be a dict, got {checks.shown(stored)}")
    generator = random_state.get_state(legacy=False)["bit_generator"]
    if stored.get("bit_generator") != generator:
        other = checks.shown(stored.get("bit_generator"))
        raise ValueError(f"state['random'] must be of a {generator}, got one of {other}")
    numbers = stored.get("state")
    for name, value in numbers.items() if isinstance(numbers, Mapping) else ():
        checks.array_of(value, f"state['random']['state'][{name!r}]")
    try:
        np.random.RandomState(getattr(np.random, generator)()).set_state(dict(stored))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"state['random'] is no state of a {generator}: {checks.shown(error)}") from error
    return dict(stored)

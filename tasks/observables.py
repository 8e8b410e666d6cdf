"""Composer observables of what tasks compute."""

from collections.abc import Callable, Mapping

from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import ArrayLike


class Computed(observable.Observable):
    """A quantity that a function without arguments returns.

    `observable.Generic` hands the function a physics, by a further call in every step.
    """

    def __init__(self, read: Callable[[], ArrayLike]) -> None:
        """Stores the function, which is called once a step and once a reset."""
        super().__init__(update_interval=1, buffer_size=None, delay=None, aggregator=None, corruptor=None)
        self._read = read

    def _callable(self, physics: mjcf.Physics) -> Callable[[], ArrayLike]:
        return self._read


def joined(*parts: Mapping[str, observable.Observable]) -> dict[str, observable.Observable]:
    """Returns observables by key, in order; a ValueError where two have the same key."""
    keys = [key for part in parts for key in part]
    if taken := sorted({key for key in keys if keys.count(key) > 1}):
        raise ValueError(f"extra_observations must have other names than the task's own observations: {taken}")
    return {key: value for part in parts for key, value in part.items()}

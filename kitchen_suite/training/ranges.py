"""Ranges of hyperparameters, which are in the annotations of their types, and the check that each value is in its."""

import dataclasses
import math
import numbers
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np

from kitchen_suite import checks

# Largest number of steps that is accepted; beyond it a mistake is more likely than a wish.
MAX_STEPS = 10**12


@dataclasses.dataclass(frozen=True)
class Interval:
    """The numbers that a hyperparameter may be, in the annotation of its type.

    Attributes:
      low: lower end.
      high: upper end.
      open_low: whether all numbers are above the lower end.
      open_high: whether all numbers are below the upper end.
    """

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False

    def __contains__(self, value: float) -> bool:
        above = self.low < value if self.open_low else self.low <= value
        below = value < self.high if self.open_high else value <= self.high
        return above and below

    def __str__(self) -> str:
        """Returns the interval as mathematics writes it, such as `(0, 1]`, which is without 0."""
        return f"{'(' if self.open_low else '['}{self.low}, {self.high}{')' if self.open_high else ']'}"


# Sizes are bounded by any machine's memory.
Size = Annotated[int, Interval(1, 2**16)]
Units = Annotated[int, Interval(1, 2**14)]
SamplesOrPasses = Annotated[int, Interval(1, 2**20)]
Steps = Annotated[int, Interval(0, MAX_STEPS)]
# One that is too great ends in a message that names it: no limit would be the right one for all networks.
LearningRate = Annotated[float, Interval(0, math.inf, open_low=True, open_high=True)]
Fraction = Annotated[float, Interval(0, 1)]
# Of moving averages and processes, which would never move at 1.
Decay = Annotated[float, Interval(0, 1, open_high=True)]
# Coefficients and norms, which are off at 0.
Coefficient = Annotated[float, Interval(0, math.inf, open_high=True)]
# Factors and divisors, whose squares float32 still holds.
Factor = Annotated[float, Interval(1e-6, 10**6)]
# Added to divisors.
Epsilon = Annotated[float, Interval(1e-8, 10**6)]


def ranges(cls: type) -> dict[str, Interval]:
    """Returns the interval of each field of a class, by name; that of the elements of a tuple."""
    return {name: interval for name, (_, interval, _) in _kinds(cls).items()}


def _kinds(cls: type) -> dict[str, tuple[type, Interval, bool]]:
    """Returns the type of numbers of each field of a class, its interval, and whether it is a tuple, by name."""
    kinds = {}
    for name, hint in get_type_hints(cls, include_extras=True).items():
        is_tuple = get_origin(hint) is tuple
        kind, interval = get_args(get_args(hint)[0] if is_tuple else hint)
        kinds[name] = kind, interval, is_tuple
    return kinds


@dataclasses.dataclass(frozen=True, kw_only=True)
class InRange:
    """A dataclass whose fields are numbers, or tuples of numbers, each in the `Interval` of its annotation."""

    def __post_init__(self) -> None:
        """Raises a TypeError or a ValueError, with name, value and range, for a value out of its range."""
        for name, (kind, interval, is_tuple) in _kinds(type(self)).items():
            value = getattr(self, name)
            if is_tuple and not isinstance(value, tuple):
                raise TypeError(f"{name} must be a list of numbers in {interval}, got {checks.shown(value)}")
            for number in value if is_tuple else (value,):
                _check(number, name, kind, interval)


def _check(value: Any, name: str, kind: type, interval: Interval) -> None:
    """Raises a TypeError or a ValueError unless a value is a number of a type, int or float, in an interval."""
    allowed, noun = (numbers.Integral, "an integer") if kind is int else (numbers.Real, "a number")
    is_number = isinstance(value, allowed) and not isinstance(value, bool | np.bool_)
    if not is_number:
        raise TypeError(f"{name} must be {noun} in {interval}, got {checks.shown(value)}")
    if value not in interval:
        raise ValueError(f"{name} must be in {interval}, got {checks.shown(value)}")

"""Variations of parameters: distributions as JSON describes them, and checks of values.

A variation is a composer variation, a constant, or a list of these for the elements of a vector.
"""

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from dm_control.composer import variation
from dm_control.composer.variation import distributions
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.parameters import ParameterType
from kitchen_suite.types import Array

Variation = Any

# In the order in which tables list them.
GROUPS = ("start", "layout", "dynamics", "sensing", "appearance", "camera", "push")

SPLITS = ("seen", "held_out")

NONE = "none"  # In place of groups where nothing varies.


def unified(variations: Any) -> Any:
    """Returns an argument `variations` as a sequence of groups or distributions by parameter; None for no variation."""
    if isinstance(variations, str):
        variations = [] if variations == NONE else variations.split(",")
    return variations or None


class Choice(variation.Variation):
    """Draws one of several values, numbers or vectors, each with the same probability.

    Attributes:
      values: `(k,)` or `(k, n)`; not to be written to.
      low: least value, elementwise.
      high: greatest value, elementwise.
    """

    def __init__(self, values: Array) -> None:
        self.values = values
        self.low, self.high = np.asarray(values.min(axis=0)), np.asarray(values.max(axis=0))

    def __call__(
        self, initial_value: Any = None, current_value: Any = None, random_state: np.random.RandomState | None = None
    ) -> Array:
        return self.values[(random_state or np.random).randint(len(self.values))]

    def about(self, default: Array) -> Self:
        """Returns the same values, which are absolute."""
        return self

    def __repr__(self) -> str:
        return f"Choice({self.values.tolist()})"


class Bands(variation.Variation):
    """Draws each element uniformly from one of several intervals, which have the same probability.

    Attributes:
      intervals: bounds `(k, 2)` or `(k, 2, n)`; not to be written to.
      low: least value, elementwise.
      high: greatest value, elementwise.
    """

    def __init__(self, intervals: ArrayLike) -> None:
        """Takes intervals `(low, high)`; bounds are numbers, or arrays `(n,)` with one for each element."""
        self.intervals = np.asarray(intervals, np.float64)
        self.low = np.asarray(self.intervals[:, 0].min(axis=0))
        self.high = np.asarray(self.intervals[:, 1].max(axis=0))
        count, _, *self._shape = self.intervals.shape
        self._last = count - 1
        self._columns = np.indices(self._shape, sparse=True)
        self._start = self.intervals[0, 0]
        self._width = self.intervals[0, 1] - self.intervals[0, 0]

    def __call__(
        self, initial_value: Any = None, current_value: Any = None, random_state: np.random.RandomState | None = None
    ) -> Array:
        # One draw for each element chooses the interval and the place in it.
        places = (random_state or np.random).random_sample(self._shape)
        if not self._last:
            return self._start + places * self._width
        places = (self._last + 1) * places
        index = np.minimum(places, self._last).astype(np.int64)
        low, high = (self.intervals[(index, side, *self._columns)] for side in (0, 1))
        return low + (places - index) * (high - low)

    def about(self, default: Array) -> "Bands":
        """Returns the same intervals in the shape of a parameter's default value."""
        count, _, *shape = self.intervals.shape
        intervals = self.intervals if shape else self.intervals.reshape(count, 2, *np.ones_like(default.shape))
        return Bands(np.broadcast_to(intervals, (count, 2, *default.shape)))

    def __repr__(self) -> str:
        return f"Bands({self.intervals.tolist()})"


class Offsets(Bands):
    """Intervals about a parameter's default value, which is read from the model."""

    def about(self, default: Array) -> Bands:
        """Returns the intervals about a default value, in its shape."""
        return Bands(default + super().about(default).intervals)


@dataclasses.dataclass(frozen=True)
class _Distribution:
    """A composer distribution: its class; the meanings of its arguments, for messages; whether these are bounds."""

    make: Callable[..., variation.Variation]
    arguments: tuple[str, ...]
    ordered: bool = False
    dtype: type = float


# By name in JSON. A `choice` has any number of values instead of arguments.
DISTRIBUTIONS: Mapping[str, _Distribution] = MappingProxyType(
    {
        "uniform": _Distribution(distributions.Uniform, ("low", "high"), ordered=True),
        "uniform_integer": _Distribution(distributions.UniformInteger, ("low", "excluded high"), True, int),
        "normal": _Distribution(distributions.Normal, ("mean", "standard deviation")),
        "log_normal": _Distribution(distributions.LogNormal, ("mean of the logarithm", "its standard deviation")),
        "exponential": _Distribution(distributions.Exponential, ("mean",)),
        "poisson": _Distribution(distributions.Poisson, ("mean",)),
        "bernoulli": _Distribution(distributions.Bernoulli, ("probability of 1",)),
    }
)


def parse(value: Any, parameter_type: ParameterType, name: str) -> Variation:
    """Returns the variation that JSON describes; constants and composer variations are returned as they are.

    Args:
      value: `{"uniform": [low, high]}` or another one of `DISTRIBUTIONS` with the list of its arguments, or
        `{"choice": [value, value, ...]}`. Arguments are numbers, or lists with the parameter's shape. A list may hold
        distributions for some of its elements.
      parameter_type: kind of the parameter.
      name: of the parameter, for messages.
    """
    if isinstance(value, Mapping):
        return _distribution(value, parameter_type.shape, parameter_type, name)
    if not isinstance(value, list | tuple):
        return value
    if is_constant(value):
        parameter_type.checked([0.0 if isinstance(part, Mapping) else part for part in value], name)
    return tuple(_distribution(part, (), parameter_type, name) if isinstance(part, Mapping) else part for part in value)


def is_constant(value: Variation) -> bool:
    """Whether a variation draws nothing."""
    parts = value if isinstance(value, list | tuple) else (value,)
    return not any(callable(part) for part in parts)


def draws_fit(each: Variation, parameter_type: ParameterType, name: str) -> bool:
    """Checks a constant, or the extremes of a bounded distribution; returns whether all draws then fit it.

    False for variations whose draws have to be checked one by one. Raises as `ParameterType.checked`.
    """
    if is_constant(each):
        parameter_type.checked(each, name)
        return False
    if isinstance(each, Choice):
        extremes = [*each.values]
    elif isinstance(each, Bands) and parameter_type.choices is None:
        extremes = [each.low, each.high]
    else:
        return False
    for extreme in extremes:
        parameter_type.checked(extreme, name)
    return True


def _distribution(
    value: Mapping[str, Any], shape: tuple[int, ...], parameter_type: ParameterType, name: str
) -> variation.Variation:
    """Returns the distribution with values of a given shape that JSON describes."""
    if len(value) != 1:
        raise ValueError(f"{name} must be one distribution, such as {{'uniform': [0, 1]}}, got {checks.shown(value)}")
    ((kind, arguments),) = value.items()
    checks.choice(kind, (*DISTRIBUTIONS, "choice"), f"{name}: distribution")
    what = f"{kind} of {name}"
    if not isinstance(arguments, list | tuple) or not arguments:
        raise ValueError(f"{what} must have a list of numbers, got {checks.shown(arguments)}")
    arrays = [_argument(argument, shape, what) for argument in arguments]
    shown = checks.shown([array.tolist() for array in arrays])
    is_bounded = kind == "choice" or DISTRIBUTIONS[kind].ordered
    if is_bounded and parameter_type.non_negative and any((array < 0).any() for array in arrays):
        raise ValueError(f"{what} must be non-negative, got {shown}")
    return Choice(np.array(arrays)) if kind == "choice" else _of_arguments(DISTRIBUTIONS[kind], arrays, shown, what)


def _of_arguments(distribution: _Distribution, arrays: list[Array], shown: str, what: str) -> variation.Variation:
    """Returns a distribution with given arguments, and draws from it once, so that numpy checks them."""
    if len(arrays) != len(distribution.arguments):
        raise ValueError(f"{what} must have {' and '.join(distribution.arguments)}, got {shown}")
    if distribution.ordered and (arrays[0] > arrays[1]).any():
        raise ValueError(f"{what} must have a low that is not above its high, got {shown}")
    with np.errstate(invalid="ignore"):
        arguments: list[NDArray] = [array.astype(distribution.dtype) for array in arrays]
    if any((argument != array).any() for argument, array in zip(arguments, arrays, strict=True)):
        raise ValueError(f"{what} must have integers, got {shown}")
    result = distribution.make(*(argument.tolist() for argument in arguments))
    try:
        result(random_state=np.random.RandomState(0))
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{what} cannot be drawn from {shown}: {error}") from error
    return result


def _argument(value: Any, shape: tuple[int, ...], what: str) -> Array:
    """Returns an argument, or a value to choose, in a given shape."""
    array = checks.array_of(value, what)
    if array.shape not in ((), shape):
        wanted = f"numbers or lists of {shape[0]}" if shape else "numbers"
        raise ValueError(f"{what} must have {wanted}, got {checks.shown(value)}")
    return np.broadcast_to(checks.vector(array.ravel(), array.size, what).reshape(array.shape), shape)


Distribution = Bands | Choice


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParameterVariation:
    """The variation of a parameter by a group.

    Attributes:
      name: of the parameter, such as `kettle/mass`.
      group: one of `GROUPS`.
      seen: distribution for training.
      held_out: distribution for evaluation, of values that `seen` does not draw if the parameter has more than two.
      limits: least and greatest value that a user's own distribution may have, where it may leave these two.
    """

    name: str
    group: str
    seen: Distribution
    held_out: Distribution
    limits: tuple[ArrayLike, ArrayLike] | None = None

    def distribution(self, split: str) -> Distribution:
        """Returns the distribution of a split, one of `SPLITS`."""
        return {"seen": self.seen, "held_out": self.held_out}[split]

    def about(self, default: Array) -> Self:
        """Returns the variation of a parameter with a default value, with distributions in its shape."""
        return dataclasses.replace(self, seen=self.seen.about(default), held_out=self.held_out.about(default))

    def range(self, default: Array) -> tuple[Array, Array]:
        """Returns the least and the greatest value of each element: over both distributions, limits and a default."""
        both = self.about(default)
        low, high = self.limits or (default, default)
        low = np.minimum.reduce([default, both.seen.low, both.held_out.low, np.asarray(low, float)])
        return low, np.maximum.reduce([default, both.seen.high, both.held_out.high, np.asarray(high, float)])


def around(name: str, group: str, *, seen: ArrayLike, held_out: ArrayLike, limits: Any = None) -> ParameterVariation:
    """Returns the variation by up to `seen` to both sides of the default; held out, by `seen` to `held_out`.

    Half widths are numbers, or one for each element; an element of half widths 0 does not vary. `limits` are
    values, see `ParameterVariation`.
    """
    inner, outer = (np.asarray(part, float) for part in np.broadcast_arrays(seen, held_out))
    return ParameterVariation(
        name=name,
        group=group,
        seen=Offsets([(-inner, inner)]),
        held_out=Offsets([(-outer, -inner), (inner, outer)]),
        limits=limits,
    )


def between(name: str, group: str, *, seen: Any, held_out: Any, limits: Any = None) -> ParameterVariation:
    """Returns the variation within an interval `(low, high)`; held out, within others, which have the same probability.

    Bounds are numbers, or arrays with one for each element; so are those of `limits`, see `ParameterVariation`.
    """
    return ParameterVariation(name=name, group=group, seen=Bands([seen]), held_out=Bands(held_out), limits=limits)


def one_of(name: str, group: str, *, seen: ArrayLike, held_out: ArrayLike) -> ParameterVariation:
    """Returns the variation among several values, each with the same probability."""
    seen_values, held_out_values = (Choice(np.asarray(values, float)) for values in (seen, held_out))
    return ParameterVariation(name=name, group=group, seen=seen_values, held_out=held_out_values)

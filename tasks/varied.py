"""Variations of the parameters of a scene by groups: values seen in training, and values held out for evaluation."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite.tasks.variations import Bands, Choice

# In the order in which tables list them.
GROUPS = ("start", "layout", "dynamics", "sensing", "appearance", "camera")

SPLITS = ("seen", "held_out")

Distribution = Bands | Choice


@dataclasses.dataclass(frozen=True, kw_only=True)
class Varied:
    """The variation of a parameter by a group.

    Attributes:
      name: of the parameter, such as `kettle/mass`.
      group: one of `GROUPS`.
      default: value without variation, in the parameter's shape and unit.
      seen: distribution for training.
      held_out: distribution for evaluation, of values that `seen` does not draw if the parameter has more than two.
    """

    name: str
    group: str
    default: NDArray[np.float64]
    seen: Distribution
    held_out: Distribution

    @property
    def low(self) -> NDArray[np.float64]:
        """Least value of each element, over both distributions and the default."""
        return np.minimum.reduce([self.default, self.seen.low, self.held_out.low])

    @property
    def high(self) -> NDArray[np.float64]:
        """Greatest value of each element, over both distributions and the default."""
        return np.maximum.reduce([self.default, self.seen.high, self.held_out.high])

    def check(self, value: NDArray[np.float64]) -> None:
        """Raises a ValueError if a value is outside the range."""
        if (value < self.low).any() or (value > self.high).any():
            bounds = f"{self.low.tolist()} and {self.high.tolist()}"
            raise ValueError(f"variation's {self.name} must be within {bounds}, got {value.tolist()}")

    def distribution(self, split: str) -> Distribution:
        """Returns the distribution of a split, one of `SPLITS`."""
        return {"seen": self.seen, "held_out": self.held_out}[split]


def around(name: str, group: str, *, default: ArrayLike = 0.0, seen: ArrayLike, held_out: ArrayLike) -> Varied:
    """Returns the variation by up to `seen` to both sides of a default; held out, by `seen` to `held_out`.

    Half widths are numbers, or one for each element; an element of half widths 0 does not vary.
    """
    middle, inner, outer = (np.asarray(part, float) for part in np.broadcast_arrays(default, seen, held_out))
    return Varied(
        name=name,
        group=group,
        default=middle,
        seen=Bands([(middle - inner, middle + inner)]),
        held_out=Bands([(middle - outer, middle - inner), (middle + inner, middle + outer)]),
    )


def between(name: str, group: str, *, default: ArrayLike, seen: Any, held_out: Sequence[Any]) -> Varied:
    """Returns the variation within an interval `(low, high)`; held out, within others, which have the same probability.

    Bounds are numbers, or arrays with one for each element.
    """
    value = np.asarray(default, float)

    def bands(*intervals: Any) -> Bands:
        return Bands(
            [(np.broadcast_to(low, value.shape), np.broadcast_to(high, value.shape)) for low, high in intervals]
        )

    return Varied(name=name, group=group, default=value, seen=bands(seen), held_out=bands(*held_out))


def one_of(name: str, group: str, *, default: ArrayLike, seen: ArrayLike, held_out: ArrayLike) -> Varied:
    """Returns the variation among several values, each with the same probability."""
    seen_values, held_out_values = (Choice(np.asarray(values, float)) for values in (seen, held_out))
    return Varied(
        name=name, group=group, default=np.asarray(default, float), seen=seen_values, held_out=held_out_values
    )

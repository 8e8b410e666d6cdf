"""Refuses bad arguments with a message that names the value, the place and what is allowed."""

import difflib
import math
import numbers
from collections.abc import Collection, Mapping, Set
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def choice(value: object, choices: Collection[str], what: str) -> str:
    """Returns `value` if it is one of `choices`.

    Raises:
      TypeError: it is not a string.
      ValueError: it is none of the choices; the message lists them and names the nearest.
    """
    if not isinstance(value, str):
        raise TypeError(f"{what} must be a string, got {value!r}")
    if value not in choices:
        near = [*_nearest(value.replace("_", " "), choices), *_nearest(value, choices)]
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise ValueError(f"{what} {value!r} does not exist{hint}; choose from {sorted(choices)}")
    return value


def _nearest(value: str, choices: Collection[str]) -> list[str]:
    return difflib.get_close_matches(value, choices, n=1)


def number(value: object, what: str, *, positive: bool = False) -> float:
    """Returns `value` as a float if it is a finite real number that is not negative (nor zero if `positive`).

    Raises:
      TypeError: it is not a real number (a bool is not one).
      ValueError: it is negative, infinite or NaN, or zero where it must be positive.
    """
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        raise TypeError(f"{what} must be a number, got {value!r}")
    if not math.isfinite(value) or value < 0 or (positive and value == 0):
        kind = "positive" if positive else "non-negative"
        raise ValueError(f"{what} must be finite and {kind}, got {value!r}")
    return float(value)


def integer(value: object, what: str, *, minimum: int) -> int:
    """Returns `value` as an int if it is an integer and not below `minimum`.

    Raises:
      TypeError: it is no integer (a bool is not one).
      ValueError: it is below `minimum`.
    """
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{what} must be an integer, got {value!r}")
    if value < minimum:
        raise ValueError(f"{what} must be at minimum {minimum}, got {value!r}")
    return int(value)


def boolean(value: object, what: str) -> bool:
    """Returns `value` if it is a bool.

    Raises:
      TypeError: it is anything else.
    """
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{what} must be True or False, got {value!r}")
    return bool(value)


def unique_names(values: object, what: str) -> tuple[object, ...]:
    """Returns `values` as a tuple if it is an ordered collection of at minimum one element, and of none twice.

    Raises:
      TypeError: it is a string, a set or an iterator, or no collection at all.
      ValueError: it is empty, or repeats an element.
    """
    if isinstance(values, str | Set | Mapping) or not isinstance(values, Collection):
        raise TypeError(f"{what} must be a sequence of names, got {values!r}")
    names = tuple(values)
    if not names:
        raise ValueError(f"{what} is empty; name at minimum one")
    if repeated := sorted({repr(name) for name in names if names.count(name) > 1}):
        raise ValueError(f"{what} names {', '.join(repeated)} more than once")
    return names


def vector(value: ArrayLike, size: int, what: str) -> NDArray[np.float64]:
    """Returns `value` as a float64 vector, unrounded, if it has `size` finite real elements.

    Raises:
      TypeError: its elements are not real numbers.
      ValueError: it has another shape, or holds NaN or inf.
    """
    array = array_of(value, what)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{what} must hold {size} numbers, got {value!r}")
    if array.shape != (size,):
        raise ValueError(f"{what} must have shape ({size},), got shape {array.shape}")
    array = array.astype(np.float64, copy=False)
    if not np.logical_and.reduce(np.isfinite(array)):
        raise ValueError(f"{what} must be finite, got {array}")
    return array


def array_of(value: object, what: str) -> NDArray:
    """Returns `value` as an array.

    Raises:
      ValueError: it is a list of parts that differ in length.
    """
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{what} must be an array, got {value!r}") from error


def matching(value: object, template: Any, what: str) -> Any:
    """Returns a copy of `value` if it is built as `template` is: the same keys and strings, arrays of the same shapes.

    Args:
      value: nested dicts of strings and arrays.
      template: likewise; numbers are taken as arrays without axes.
      what: name of `value`, for messages.

    Raises:
      TypeError: a dict or a number is expected where there is something else.
      ValueError: a key is missing or unknown, a string or a shape differs, or a number is not finite.
    """
    if isinstance(template, Mapping):
        if not isinstance(value, Mapping):
            raise TypeError(f"{what} must be a dict with the keys {sorted(template)}, got {value!r}")
        if odd := value.keys() ^ template.keys():
            raise ValueError(
                f"{what} must have the keys {sorted(template)}; missing or unknown: {sorted(map(str, odd))}"
            )
        return {key: matching(value[key], part, f"{what}[{key!r}]") for key, part in template.items()}
    if isinstance(template, str):
        if value != template:
            raise ValueError(f"{what} must be {template!r}, got {value!r}")
        return template
    expected, array = np.asarray(template), array_of(value, what)
    if array.dtype.kind not in "biuf" or (expected.dtype.kind in "biu" and array.dtype.kind == "f"):
        raise TypeError(f"{what} must hold {expected.dtype} numbers, got {value!r}")
    if array.shape != expected.shape:
        raise ValueError(f"{what} must have shape {expected.shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{what} must be finite, got {value!r}")
    return array.astype(expected.dtype)

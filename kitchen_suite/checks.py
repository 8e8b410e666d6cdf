"""Checks of arguments.

Each raises a TypeError for a value of the wrong type, and a ValueError for another that is refused, unless it says
otherwise. The message names the argument, its value and the values allowed.
"""

import collections
import difflib
import math
import numbers
import re
import reprlib
from collections.abc import Collection, Iterable, Mapping, Set
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Greatest number of episodes; beyond it a mistake is more likely than a wish.
MAX_COUNT = 10**6

# Longer episodes would exceed the 512 MiB of arrays that `files.load_arrays` reads: a control step takes up to 2 KiB.
MAX_EPISODE_STEPS = 100_000

# Bounds far above what is of use, and below what exhausts a machine before it is refused.
MAX_ENVS = 2**16
MAX_THREADS = 2**10

# Names in other libraries of what the suite calls otherwise, and the suite's names, of which the first that exists is
# suggested.
_LENGTH = ("max_episode_steps", "time_limit")
_SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "seed": ("random",),
    "controller": ("control_mode",),
    "horizon": _LENGTH,
    "max_steps": _LENGTH,
    "max_episode_length": _LENGTH,
    "episode_length": _LENGTH,
    "num_steps": _LENGTH,
    "resolution": ("image_size",),
    "camera_names": ("cameras",),
    "obs_mode": ("obs_type",),
    "observation_type": ("obs_type",),
    "n_envs": ("num_envs",),
}


_SEPARATORS = re.compile(r"[-_/.\s]+")

_FLOAT64_SIZE = 8  # [bytes]

_MAX_SHOWN = 200  # Characters of a value in a message.
_SHORTENED = " (shortened) "  # In place of the middle of a longer one.

# Of a value, a message repeats four levels of nesting, and twelve elements of a collection.
_representation = reprlib.Repr()
_representation.maxlevel = 4
for _kind in ("string", "long", "other"):
    setattr(_representation, f"max{_kind}", _MAX_SHOWN)
for _kind in ("array", "deque", "dict", "frozenset", "list", "set", "tuple"):
    setattr(_representation, f"max{_kind}", 12)


class WorkFailedError(Exception):
    """Work that failed though its arguments were right; a command ends with its message and status 1."""


def shown(value: object) -> str:
    """Returns a value as a message repeats it: in one line of limited length, whatever its size, depth and `repr`."""
    try:
        text = _representation.repr(value)
    except Exception:  # Of the value's own class; or an int of more digits than Python converts.
        text = f"<{type(value).__name__}>"
    return shortened(text)


def shortened(text: str, length: int = _MAX_SHOWN) -> str:
    """Returns a text in one line of printable characters, without its middle if it is longer than `length`."""
    line = _without_middle(" ".join(text.split()), length)
    return _without_middle(printable(line), length)


def printable(text: str) -> str:
    """Returns a text with the codes of what a terminal would obey or hide: control characters, but no line breaks."""
    return "".join(each if each.isprintable() or each == "\n" else _code(each) for each in text)


def _code(character: str) -> str:
    return character.encode("unicode_escape").decode()


def _without_middle(line: str, length: int) -> str:
    if len(line) <= length:
        return line
    half = (length - len(_SHORTENED)) // 2
    return line[:half] + _SHORTENED + line[-half:]


def choice(value: object, choices: Collection[str], name: str) -> str:
    """Returns `value` if it is one of `choices`; the error lists them and suggests the nearest."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string, got {shown(value)}")
    if value not in choices:
        raise ValueError(f"{name} {shown(value)} does not exist{hint(value, choices)}")
    return value


def hint(value: object, choices: Collection[str]) -> str:
    """Returns the end of an error that suggests the nearest choice and lists all, or the ends of a long list."""
    near = nearest(value, choices) if isinstance(value, str) else None
    meant = f" (did you mean {near!r}?)" if near else ""
    return f"{meant}; choose from {shortened(str(sorted(choices)), 800)}"


def nearest(value: str, choices: Collection[str]) -> str | None:
    """Returns the choice probably meant, if any: as `same_name`, a synonym, one that ends alike, or one spelt alike."""
    value = value[:_MAX_SHOWN]
    if same := same_name(value, choices):
        return same
    plain = _plain(value)
    if plain in _SYNONYMS:
        return next((synonym for synonym in _SYNONYMS[plain] if synonym in choices), None)
    near = [choice for choice in sorted(choices, key=len) if _plain(choice).endswith(f"_{plain}")]
    return next(iter((*near, *_spelt_like(value, choices))), None)


def same_name(value: str, choices: Iterable[str]) -> str | None:
    """Returns the choice, if any, that differs from a value in case alone, or in `-`, `_`, `/`, `.` and spaces."""
    return next((choice for choice in choices if _plain(choice) == _plain(value)), None)


def _plain(name: str) -> str:
    """Returns a name in lower case, in which `_` stands for all that separates words."""
    return _SEPARATORS.sub("_", name.strip().casefold())


def _spelt_like(value: str, choices: Collection[str]) -> list[str]:
    by_plain = {_plain(choice): choice for choice in choices}
    return [by_plain[match] for match in difflib.get_close_matches(_plain(value), by_plain, n=1)]


def keywords(
    names: Iterable[object],
    choices: Collection[str],
    *,
    what: str,
    hints: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Raises a TypeError unless each name is among the names of the arguments that there are.

    Args:
      names: of the arguments that are given.
      choices: names of all arguments.
      what: kind of the arguments, for the message.
      hints: arguments of other functions, with what does the same here, for the message.
    """
    for name in names:
        if name not in choices:
            way = hints.get(name) if isinstance(name, str) else None
            raise TypeError(f"unexpected {what} {shown(name)}" + (f": {way}" if way else hint(name, choices)))


def number(value: object, name: str, *, positive: bool = False, maximum: float = math.inf) -> float:
    """Returns `value` as a float if it is a finite number from 0, or above 0 if `positive`, to `maximum`."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be a number, got {shown(value)}")
    try:
        is_finite = math.isfinite(value)
    except OverflowError:  # An int beyond all floats.
        is_finite = False
    if not is_finite or value < 0 or (positive and value == 0):
        kind = "positive" if positive else "non-negative"
        raise ValueError(f"{name} must be finite and {kind}, got {shown(value)}")
    if float(value) > maximum:
        raise ValueError(f"{name} must be at most {maximum:g}, got {shown(value)}")
    return float(value)


def integer(value: object, name: str, *, minimum: int, maximum: int | None = None) -> int:
    """Returns `value` as an int if it is an integer, and no bool, from `minimum` to `maximum`."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{name} must be an integer, got {shown(value)}")
    if value < minimum:
        raise ValueError(f"{name} must be at least {minimum}, got {shown(value)}")
    if maximum is not None and int(value) > maximum:
        raise ValueError(f"{name} must be at most {maximum}, got {shown(value)}")
    return int(value)


def boolean(value: object, name: str) -> bool:
    """Returns `value` if it is a bool."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def reset_options(value: object, names: Collection[str], *, elsewhere: Collection[str] = ()) -> dict[str, Any]:
    """Returns those options of a reset that are among `names`; an empty dict for None.

    Other options are left out without an error, since libraries pass options of their own, unless they are spelt much
    like one of the suite's: of `names`, or of those `elsewhere`, which other environments of the suite have.
    """
    if value is not None and not isinstance(value, Mapping):
        raise TypeError(f"options must be a dict, got {shown(value)}")
    for name in (value or {}).keys() - {*names}:
        if not isinstance(name, str) or _spelt_like(name[:_MAX_SHOWN], {*names, *elsewhere}):
            choice(name, names, "option")
    return {name: option for name, option in (value or {}).items() if name in names}


def unique_names(values: object, name: str, *, minimum: int = 1) -> tuple[object, ...]:
    """Returns `values` as a tuple if it is an ordered collection of at least `minimum` items and repeats no string."""
    if isinstance(values, str | bytes | Set | Mapping) or not isinstance(values, Collection):
        raise TypeError(f"{name} must be a sequence of names, got {shown(values)}")
    result = tuple(values)
    if len(result) < minimum:
        raise ValueError(f"{name} is empty; name at least one")
    counts = collections.Counter(value for value in result if isinstance(value, str))
    if repeated := sorted(repr(value) for value, count in counts.items() if count > 1):
        raise ValueError(f"{name} names {shortened(', '.join(repeated))} more than once")
    return result


def arguments(value: object, name: str) -> Mapping[str, Any]:
    """Returns arguments by name, where `name` holds a mapping of them, or None for no arguments."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a dict or None, got {shown(value)}")
    return value


def groups(names: Iterable[str]) -> set[str]:
    """Returns the groups of names whose parts have slashes between them: of `a/b/c`, these are `a` and `a/b`."""
    paths = [name.split("/") for name in names]
    return {"/".join(parts[:depth]) for parts in paths for depth in range(1, len(parts))}


def vector(value: ArrayLike, size: int, name: str) -> NDArray[np.float64]:
    """Returns `value` as a float64 vector, unrounded, if it has `size` finite real elements."""
    array = array_of(value, name)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} must hold {size} numbers, got {shown(value)}")
    if array.shape != (size,):
        number = "" if array.ndim else f", the number {shown(value)}"
        raise ValueError(f"{name} must have shape ({size},), got shape {array.shape}{number}")
    if array.dtype.itemsize > _FLOAT64_SIZE:
        # Wider types overflow to inf. The context takes longer than the conversion.
        with np.errstate(over="ignore"):
            array = array.astype(np.float64)
    elif array.dtype != np.float64:
        array = array.astype(np.float64)
    # A zero byte is an element that is not finite. To look for it takes half of the time of a reduction.
    if 0 in np.isfinite(array).tobytes():
        raise ValueError(f"{name} must be finite, got {shown(value)}")
    return array


def array_of(value: object, name: str) -> NDArray:
    """Returns `value` as an array of NumPy's own class, without copying one.

    Raises a ValueError for a list of parts that differ in length, and for masked entries, which have no value.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} must be an array, got {shown(value)}") from error
    # What holds objects may be nested to any depth.
    if array is not value and array.dtype != object and _is_masked(value):
        raise ValueError(f"{name} must not have masked entries, got {shown(value)}: fill them, by its method filled")
    return array


def _is_masked(value: object) -> bool:
    """Whether a value is a masked array with masked entries, or a sequence that holds one."""
    if isinstance(value, list | tuple):
        return any(map(_is_masked, value))
    return isinstance(value, np.ma.MaskedArray) and bool(np.ma.is_masked(value))


def matching(value: object, template: Any, name: str) -> Any:
    """Returns a copy of `value` if it has the keys and strings of `template`, and arrays of the same shapes.

    Both are nested dicts of strings and arrays; a number counts as an array of shape `()`.
    """
    if isinstance(template, Mapping):
        if not isinstance(value, Mapping):
            raise TypeError(f"{name} must be a dict with the keys {sorted(template)}, got {shown(value)}")
        if odd := value.keys() ^ template.keys():
            names = shortened(", ".join(sorted(map(shown, odd))))
            raise ValueError(f"{name} must have the keys {sorted(template)}; missing or unknown: [{names}]")
        return {key: matching(value[key], part, f"{name}[{key!r}]") for key, part in template.items()}
    if isinstance(template, str):
        if value != template:
            raise ValueError(f"{name} must be {template!r}, got {shown(value)}")
        return template
    expected, array = np.asarray(template), array_of(value, name)
    if array.dtype.kind not in "biuf" or (expected.dtype.kind in "biu" and array.dtype.kind == "f"):
        raise TypeError(f"{name} must hold {expected.dtype} numbers, got {shown(value)}")
    if array.shape != expected.shape:
        raise ValueError(f"{name} must have shape {expected.shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {shown(value)}")
    return array.astype(expected.dtype)

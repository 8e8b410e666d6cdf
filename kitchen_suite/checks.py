"""Checks of arguments.

Each raises a TypeError for a value of the wrong type, and a ValueError for another that is refused, unless it says
otherwise. The message names the argument, its value and the values allowed.
"""

import collections
import difflib
import importlib.util
import inspect
import math
import numbers
import pkgutil
import reprlib
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Set
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Bounds far above what is of use, and below what exhausts a machine before it is refused.
MAX_ENVS = 2**16
MAX_THREADS = 2**10

# Names in other libraries of what the suite calls otherwise.
_SYNONYMS = {"seed": "random", "controller": "control_mode", "horizon": "max_episode_steps", "resolution": "image_size"}

_MAX_SHOWN = 200  # Characters of a value in a message.
_SHORTENED = " (shortened) "  # In place of the middle of a longer one.

# Of a value, a message repeats four levels of nesting, and twelve elements of a collection.
_representation = reprlib.Repr()
_representation.maxlevel = 4
for _kind in ("string", "long", "other"):
    setattr(_representation, f"max{_kind}", _MAX_SHOWN)
for _kind in ("array", "deque", "dict", "frozenset", "list", "set", "tuple"):
    setattr(_representation, f"max{_kind}", 12)


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
    escaped = "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in line)
    return _without_middle(escaped, length)


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
        raise ValueError(f"{name} {shown(value)} does not exist{_hint(value, choices)}")
    return value


def installed(packages: Iterable[str], what: str, extra: str) -> None:
    """Raises an ImportError with the pip command of an extra if `what` needs packages that are not installed."""
    if missing := [name for name in packages if not importlib.util.find_spec(name)]:
        raise ImportError(f"{what} needs {' and '.join(missing)}: {install_command(extra)}")


def version_of(package: str) -> str | None:
    """Returns the version of a package; None if it is not installed."""
    import importlib.metadata  # A tenth of the time that the suite takes to be imported.

    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def install_command(extra: str) -> str:
    """Returns the pip command that installs an extra."""
    # Of the checkout that pip runs in, until a release is on a package index.
    return f"pip install '.[{extra}]'"


def imported(name: str, what: str) -> Any:
    """Returns the object `module:name`, also from the working directory; the ValueError of no such one names `what`."""
    # Unlike `python -m`, console scripts do not look there. Last, so that it hides no installed module.
    if (directory := str(Path.cwd())) not in sys.path:
        sys.path.append(directory)
    try:
        return pkgutil.resolve_name(name)
    except (Exception, SystemExit) as error:  # Importing runs the code of the module.
        problem = shortened(f"{type(error).__name__}: {error}", 500)
        raise ValueError(f"{what} {shown(name)} cannot be imported: {problem}") from error


def _hint(value: object, choices: Collection[str]) -> str:
    """Returns the end of an error that suggests the nearest choice and lists all, or the ends of a long list."""
    near = nearest(value, choices) if isinstance(value, str) else None
    meant = f" (did you mean {near!r}?)" if near else ""
    return f"{meant}; choose from {shortened(str(sorted(choices)), 800)}"


def nearest(value: str, choices: Collection[str]) -> str | None:
    """Returns the choice probably meant, if any: a synonym, one that ends with the value, or one spelt like it."""
    value = value[:_MAX_SHOWN]
    if synonym := _SYNONYMS.get(value):
        return synonym if synonym in choices else None
    ends = tuple(f"{mark}{value}" for mark in "/_ ")
    near = [choice for choice in sorted(choices, key=len) if choice.endswith(ends)]
    return next(iter((*near, *_spelt_like(value, choices))), None)


def _spelt_like(value: str, choices: Collection[str]) -> list[str]:
    spellings = (value.replace("_", " "), value)
    return [match for spelling in spellings for match in difflib.get_close_matches(spelling, choices, n=1)]


def keywords(
    names: Iterable[object],
    *functions: Callable[..., Any],
    what: str,
    exclude: Collection[str] = (),
    elsewhere: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Raises a TypeError unless each name is a keyword argument of one of the functions, or classes.

    Args:
      names: of the arguments.
      *functions: functions, or classes.
      what: kind of the arguments, for the message.
      exclude: arguments that are set otherwise.
      elsewhere: arguments of other functions, with what does the same here, for the message.
    """
    parameters = [parameter for function in functions for parameter in inspect.signature(function).parameters.values()]
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    choices = {parameter.name for parameter in parameters if parameter.kind in by_name}.difference(exclude)
    for name in names:
        if name not in choices:
            way = elsewhere.get(name) if isinstance(name, str) else None
            raise TypeError(f"unexpected {what} {shown(name)}" + (f": {way}" if way else _hint(name, choices)))


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


def vector(value: ArrayLike, size: int, name: str) -> NDArray[np.float64]:
    """Returns `value` as a float64 vector, unrounded, if it has `size` finite real elements."""
    array = array_of(value, name)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} must hold {size} numbers, got {shown(value)}")
    if array.shape != (size,):
        number = "" if array.ndim else f", the number {shown(value)}"
        raise ValueError(f"{name} must have shape ({size},), got shape {array.shape}{number}")
    if array.dtype != np.float64:
        # Wider types overflow to inf.
        with np.errstate(over="ignore"):
            array = array.astype(np.float64)
    if not np.logical_and.reduce(np.isfinite(array)):
        raise ValueError(f"{name} must be finite, got {shown(value)}")
    return array


def array_of(value: object, name: str) -> NDArray:
    """Returns `value` as an array, unless it is a list of parts that differ in length."""
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} must be an array, got {shown(value)}") from error


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

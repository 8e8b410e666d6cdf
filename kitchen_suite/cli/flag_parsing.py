"""Flags of a command from its settings dataclass: how their text is parsed and checked."""

import dataclasses
import json
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from absl import flags

from kitchen_suite.cli.options import OPTIONS, Option


class _Parser(flags.ArgumentParser):
    """Parses and checks a flag's text by the type of its field."""

    def __init__(self, convert: Callable[[str], Any], option: Option, what: str) -> None:
        self._convert, self._option, self._what = convert, option, what

    def flag_type(self) -> str:
        return self._what

    def parse(self, argument: Any) -> Any:
        if not isinstance(argument, str):  # A default, which is checked where it is used.
            return argument
        option, value = self._option, self._convert(argument)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, int | float) and not option.minimum <= number <= option.maximum:
                bound = f"least {option.minimum}" if number < option.minimum else f"most {option.maximum}"
                raise ValueError(f"must be at {bound}")
        if option.choices and value not in option.choices:
            raise ValueError(f"must be one of {', '.join(option.choices)}")
        option.check(value)
        return value


class _BooleanParser(flags.BooleanParser):
    """Parses a boolean flag, with an error in words."""

    def parse(self, argument: Any) -> bool:
        try:
            return super().parse(argument)
        except ValueError:
            raise ValueError("must be true or false, or the flag alone") from None


class _Flags(flags.FlagValues):
    """Flags without absl's --flagfile, which would read any file or device."""

    def read_flags_from_files(self, argv: Sequence[str], force_gnu: bool = True) -> list[str]:
        return list(argv)


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{text!r} is not an integer") from None


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise ValueError("must be finite")
    return value


def _json_object(text: str) -> dict[str, Any]:
    try:
        value = json.loads(text)
    except (RecursionError, ValueError) as error:
        hint = f'; for the JSON in that file write "$(cat {text})"' if text.endswith(".json") else ""
        raise ValueError(f"not JSON: {error}{hint}") from error
    if not isinstance(value, dict):
        raise ValueError("must be a JSON object")
    return value


def _path(text: str) -> Path:
    if not text:
        raise ValueError("is empty")
    return Path(text)


def _paths(text: str) -> tuple[Path, ...]:
    return tuple(_path(part) for part in text.split(","))


def _integers(text: str) -> tuple[int, ...]:
    return tuple(_integer(part) for part in text.split(","))


_PARSERS: Mapping[Any, tuple[Callable[[str], Any], str]] = MappingProxyType(
    {
        int: (_integer, "an integer"),
        float: (_number, "a number"),
        str: (str, "a string"),
        Path: (_path, "a path"),
        Mapping[str, Any]: (_json_object, "a JSON object"),
        tuple[Path, ...]: (_paths, "paths"),
        tuple[int, ...]: (_integers, "integers"),
    }
)


def define_flags(settings: type, *, exclude: str | None = None) -> flags.FlagValues:
    """Defines the flags of a settings dataclass, and `--help` and `--version`.

    They are not absl's global flags, so that a command can be called from other programs, any number of times.

    Args:
      settings: a dataclass whose field names are keys of `OPTIONS`.
      exclude: field that is not a flag.
    """
    values = _Flags()
    hints = typing.get_type_hints(settings)
    for field in dataclasses.fields(settings):
        if field.name != exclude:
            _define(values, field, _without_none(hints[field.name]))
    for name, short in (("help", "h"), ("version", None)):
        _define_boolean(values, name, default=False, short_name=short)
    return values


def _define(values: flags.FlagValues, field: dataclasses.Field, kind: Any) -> None:
    option, default = OPTIONS[field.name], None if field.default is dataclasses.MISSING else field.default
    if field.default_factory is not dataclasses.MISSING:
        default = field.default_factory()
    if kind is bool:
        _define_boolean(values, field.name, default)
        return
    convert, what = _PARSERS[kind]
    serializer: flags.ArgumentSerializer = flags.ArgumentSerializer()
    flags.DEFINE(_Parser(convert, option, what), field.name, default, option.help, values, serializer)


def _define_boolean(values: flags.FlagValues, name: str, default: Any, short_name: str | None = None) -> None:
    flag = flags.BooleanFlag(name, default, OPTIONS[name].help, short_name)
    flag.parser = _BooleanParser()
    flags.DEFINE_flag(flag, values)


def _without_none(hint: Any) -> Any:
    """Returns `T` of `T | None`."""
    if isinstance(hint, types.UnionType):
        (hint,) = (part for part in typing.get_args(hint) if part is not types.NoneType)
    return hint

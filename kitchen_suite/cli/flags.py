"""The flags of a command: one for each field of its settings, with the type, default and `Flag` of the field."""

import dataclasses
import functools
import inspect
import json
import math
import textwrap
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Any

from absl import flags

from kitchen_suite.settings import WIDTH, Flag


class Setting(typing.NamedTuple):
    """A field of a settings dataclass; `default` is `dataclasses.MISSING` where it is required."""

    name: str
    kind: Any
    flag: Flag
    default: Any

    @property
    def is_required(self) -> bool:
        """Whether the command cannot run without it."""
        return self.default is dataclasses.MISSING

    @property
    def ending(self) -> str:
        """The sentence on the default, or on what applies without the flag; empty where there is neither."""
        if self.is_required:
            return " Required."
        if self.default is None or self.default in ((), {}):
            return f" Default: {self.flag.unset}." if self.flag.unset else ""
        return "" if self.default is False else f" Default: {self.default}."


_HELP = Setting("help", bool, Flag(help="Show this help, and exit."), False)
_VERSION = Setting("version", bool, Flag(help="Show the version of the suite, and exit."), False)


def settings_of(dataclass: type) -> list[Setting]:
    """Returns the fields of a settings dataclass: its own first, then those of its bases."""
    hints, fields = typing.get_type_hints(dataclass), {field.name: field for field in dataclasses.fields(dataclass)}
    found = []
    for name in dict.fromkeys(name for base in dataclass.__mro__ for name in inspect.get_annotations(base)):
        kind, field = hints[name], fields[name]
        if isinstance(kind, UnionType):  # Of the type and None.
            kind, _ = typing.get_args(kind)
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        found.append(Setting(name, kind, field.metadata["flag"], default))
    return found


def define(settings: Sequence[Setting]) -> flags.FlagValues:
    """Defines the flags of settings, `--help` and `--version`.

    They are not absl's global flags, so that a command can be called from other programs, any number of times.
    """
    values = _Flags()
    for setting in (*settings, _HELP, _VERSION):
        default = None if setting.is_required else setting.default
        if setting.kind is bool:
            short_name = "h" if setting is _HELP else None
            flags.DEFINE_boolean(setting.name, default, setting.flag.help, values, short_name=short_name)
            values[setting.name].parser = _BooleanParser()
        else:
            flags.DEFINE(_Parser(setting), setting.name, default, setting.flag.help, values)
    return values


def describe(settings: Sequence[Setting], positional: str | None) -> str:
    """Returns the rows of the help."""
    rows = []
    for setting in (*settings, _HELP, _VERSION):
        first = f"  {setting.name.upper():<21} " if setting.name == positional else f"  --{setting.name:<19} "
        wrapper = textwrap.TextWrapper(WIDTH, first, subsequent_indent=" " * 24, break_on_hyphens=False)
        rows.append(wrapper.fill(f"{setting.flag.help}{setting.ending}"))
    return "\n".join(rows)


class _Flags(flags.FlagValues):
    """Flags without absl's --flagfile, which would read any file or device."""

    def read_flags_from_files(self, argv: Sequence[str], force_gnu: bool = True) -> list[str]:
        return list(argv)


class _Parser(flags.ArgumentParser):
    """Parses and checks a flag's text by the type of its field; lists are separated by commas."""

    def __init__(self, setting: Setting) -> None:
        self._flag = setting.flag
        self._is_list = typing.get_origin(setting.kind) is tuple
        self._read = _READERS[typing.get_args(setting.kind)[0] if self._is_list else setting.kind]

    def parse(self, argument: Any) -> Any:
        if not isinstance(argument, str):  # A default.
            return argument
        return tuple(map(self._value, argument.split(","))) if self._is_list else self._value(argument)

    def _value(self, text: str) -> Any:
        flag, value = self._flag, self._read(text)
        if isinstance(value, int | float) and not flag.minimum <= value <= flag.maximum:
            raise ValueError(
                f"must be at {f'least {flag.minimum}' if value < flag.minimum else f'most {flag.maximum}'}"
            )
        if flag.choices and value not in flag.choices:
            raise ValueError(f"must be one of {', '.join(flag.choices)}")
        flag.check(value)
        return value


class _BooleanParser(flags.BooleanParser):
    """Parses a boolean flag, with an error in words."""

    def parse(self, argument: Any) -> bool:
        try:
            return super().parse(argument)
        except ValueError:
            raise ValueError("must be true or false, or the flag alone") from None


def _number(kind: type, name: str, text: str) -> float:
    try:
        value = kind(text)
    except ValueError:
        raise ValueError(f"{text!r} is not {name}") from None
    if kind is float and not math.isfinite(value):
        raise ValueError("must be finite")
    return value


def _path(text: str) -> Path:
    if not text:
        raise ValueError("is empty")
    return Path(text)


def _json_object(text: str) -> dict[str, Any]:
    try:
        value = json.loads(text)
    except (RecursionError, ValueError) as error:
        hint = f'; for the JSON in that file write "$(cat {text})"' if text.endswith(".json") else ""
        raise ValueError(f"not JSON: {error}{hint}") from error
    if not isinstance(value, dict):
        raise ValueError("must be a JSON object")
    return value


_READERS: Mapping[Any, Callable[[str], Any]] = MappingProxyType(
    {
        str: str,
        int: functools.partial(_number, int, "an integer"),
        float: functools.partial(_number, float, "a number"),
        Path: _path,
        Mapping[str, Any]: _json_object,
    }
)

"""A command: it parses its flags, prepares a job, runs it, and reports every problem in one line; also as a process.

Its flags are the fields of its settings, each with the type, default and `Flag` of the field.
"""

import contextlib
import dataclasses
import functools
import inspect
import math
import os
import pkgutil
import signal
import sys
import textwrap
import typing
import warnings
from collections.abc import Callable, Mapping, Sequence
from io import TextIOWrapper
from pathlib import Path
from types import FrameType, UnionType
from typing import Any, ClassVar, NamedTuple, Protocol, cast

from absl import flags

import kitchen_suite
from kitchen_suite import checks, files
from kitchen_suite.rendering import gl
from kitchen_suite.settings import BROKEN_PIPE, FAILURE, INTERRUPTED, SUCCESS, USAGE, WIDTH, Flag

# Errors of the preparation.
_ERRORS = dict.fromkeys((flags.Error, ImportError, OSError, TypeError, ValueError), USAGE)

# Signals that have interrupted this process.
_interrupts: list[int] = []


class Job(Protocol):
    """A command's work, prepared so that bad arguments have been refused.

    Exceptions of `run` that are `errors` end the command with one line, and the exit status of the first that matches.
    """

    errors: ClassVar[Mapping[type[Exception], int]]

    def run(self) -> bool | int:
        """Does the work; returns whether it succeeded, or an exit status of the command's own."""

    def progress(self) -> str:
        """Returns how far the work came, for the line that reports an interrupt."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Command:
    """A console script of a name.

    Attributes:
      description: text above the flags in `--help`; its first sentence is the command's in the list of all.
      settings: dataclass of the command's settings; each field is a flag, those without a default are required.
      job: `module:callable` that returns a `Job` for the settings. The module is imported after the GL library has been
        chosen, since dm_control chooses one when it is imported.
      details: returns further text for `--help`.
      renders: whether pictures will be rendered with given settings; None where the job will find out.
      positional: the field that is given without a flag, if any.
      needs: packages that the job imports, and the extra that installs them.
    """

    name: str
    description: str
    settings: type
    job: str
    details: Callable[[], str] = str
    renders: Callable[[Any], bool | None] = lambda settings: False
    positional: str | None = None
    needs: tuple[tuple[str, ...], str] = ((), "")

    def __call__(self) -> int:
        return run_process(self.name, self.main)

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Runs the command with some arguments, by default those of this process; returns the exit status."""
        job: Job | None = None
        ended: bool | int = True
        try:
            settings = self.parse(sys.argv[1:] if arguments is None else arguments)
            if not isinstance(settings, str):
                job = self._prepare(settings)
                ended = job.run()
        except (Exception, KeyboardInterrupt) as error:
            return self._end(error, job)
        if _interrupts:
            return self._end(KeyboardInterrupt(), job)
        if job is None:
            print(settings)
        if isinstance(ended, bool):
            return SUCCESS if ended else FAILURE
        return ended

    def parse(self, arguments: Sequence[str]) -> Any:
        """Returns the settings, or the text of `--help` or `--version`; an `absl.flags.Error` for bad arguments."""
        settings = settings_of(self.settings)
        values = define([setting for setting in settings if setting.name != self.positional])
        _, *others = values([self.name, *arguments], known_only=True)
        others = [text for text in others if text != "--"]
        unknown = [text.lstrip("-").partition("=")[0] for text in others if text.startswith("-")]
        # The first shows the help on Windows, the others in absl's programs.
        if values.help or (unknown and unknown[0] in ("?", "helpfull", "helpshort")):
            return f"{self.description}{self.details()}\nFlags:\n{describe(settings, self.positional)}"
        if values.version:
            return f"{self.name} {kitchen_suite.__version__}"
        if unknown:
            near = checks.nearest(unknown[0], list(values))
            hint = f" (did you mean --{near}?)" if near else ""
            raise flags.Error(f"there is no flag --{unknown[0]}{hint}; --help lists all")
        chosen = {setting.name: values[setting.name].value for setting in settings if setting.name in values}
        if self.positional and others:
            chosen[self.positional], *others = others
        if others:
            raise flags.Error(f"unexpected argument {checks.shown(others[0])}: all others are flags, see --help")
        for setting in settings:
            if setting.is_required and chosen.get(setting.name) is None:
                flag = setting.name if setting.name == self.positional else f"--{setting.name}"
                raise flags.Error(f"{flag} is missing: {setting.flag.help}")
        return self.settings(**chosen)

    def _prepare(self, settings: Any) -> Job:
        packages, extra = self.needs
        checks.installed(packages, self.name, extra)
        gl.prepare(rendering=self.renders(settings))
        return pkgutil.resolve_name(self.job)(settings)

    def _end(self, error: BaseException, job: Job | None) -> int:
        """Reports an error of a job, or of its preparation where there is none; returns the exit status.

        Interrupts prevail, whatever became of them: imports of extension modules, for example, raise an ImportError.
        """
        if _interrupts or isinstance(error, KeyboardInterrupt):
            return fail(self.name, f"interrupted {job.progress()}" if job else "interrupted", INTERRUPTED)
        errors = job.errors if job else _ERRORS
        status = next((status for kind, status in errors.items() if isinstance(error, kind)), None)
        if status is None or isinstance(error, BrokenPipeError):
            raise error
        return fail(self.name, error, status)


class Setting(NamedTuple):
    """A field of a settings dataclass; `default` is `dataclasses.MISSING` where it is required."""

    name: str
    kind: Any
    flag: Flag
    default: Any

    @property
    def is_required(self) -> bool:
        return self.default is dataclasses.MISSING

    @property
    def ending(self) -> str:
        """The sentence on the default, or on what applies without the flag; empty where there is neither."""
        if self.is_required:
            return " Required."
        if self.default is None or self.default in ((), {}):
            unset = self.flag.unset() if callable(self.flag.unset) else self.flag.unset
            return f" Default: {unset}." if unset else ""
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
    """Defines the flags of settings, `--help` and `--version`."""
    # Not absl's global flags, so that a command can be called from other programs, any number of times.
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
            bound = f"least {flag.minimum}" if value < flag.minimum else f"most {flag.maximum}"
            raise ValueError(f"must be at {bound}")
        if flag.choices and value not in flag.choices:
            near = checks.nearest(value, flag.choices)
            hint = f" (did you mean {near}?)" if near else ""
            raise ValueError(f"must be one of {', '.join(flag.choices)}{hint}")
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
        raise ValueError(f"{checks.shown(text)} is not {name}") from None
    if kind is float and not math.isfinite(value):
        raise ValueError("must be finite")
    return value


def _path(text: str) -> Path:
    if not text:
        raise ValueError("is empty")
    return Path(text)


def _json_object(text: str) -> dict[str, Any]:
    try:
        value = files.parse_json(text)
    except ValueError as error:
        hint = f'; for the JSON in that file write "$(cat {text})"' if text.endswith(".json") else ""
        raise ValueError(f"cannot be read as JSON: {error}{hint}") from error
    if not isinstance(value, dict):
        raise ValueError("must be a JSON object")
    return value


_READERS: Mapping[Any, Callable[[str], Any]] = {
    str: str,
    int: functools.partial(_number, int, "an integer"),
    float: functools.partial(_number, float, "a number"),
    Path: _path,
    Mapping[str, Any]: _json_object,
}


def fail(name: str, problem: object, status: int) -> int:
    """Reports a problem in one line on stderr, if that can be written to; returns the exit status."""
    with contextlib.suppress(OSError):
        # It may quote any argument.
        print(f"{name}:", checks.shortened(str(problem), 1000), file=sys.stderr)
    return status


def run_process(name: str, main: Callable[[], int]) -> int:
    """Runs `main` as a command's process, with signals, and streams that may be closed; both return the exit status."""
    _open_closed_streams()
    # Python's warnings take one line, without the line of code that they are about.
    warnings.formatwarning = lambda message, category, *_, **__: f"{category.__name__}: {message}\n"
    status = SUCCESS
    try:
        # SIGTERM too, with which batch systems stop a job. SIGINT stays ignored where it is, as in background jobs.
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            if number is not signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, _interrupt)
        sys.unraisablehook = _raise_again
        status = main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        return fail(name, "interrupted", INTERRUPTED)
    except OSError as error:
        # What Python still has to flush at exit is sent to the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # The reader of the output has left.
            return BROKEN_PIPE
        return status or fail(name, f"stdout cannot be written to: {error}", FAILURE)
    return status


def _interrupt(number: int, frame: FrameType | None) -> None:
    _interrupts.append(number)
    raise KeyboardInterrupt


def _raise_again(unraisable: Any) -> None:
    """Raises an interrupt again that Python has dropped, since a destructor cannot raise exceptions."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        signal.setitimer(signal.ITIMER_REAL, 0.01)
    else:
        sys.__unraisablehook__(unraisable)


def _open_closed_streams() -> None:
    """Opens the null device for each closed standard stream, and lets stdout escape characters that it cannot encode.

    Files that are opened later would get the numbers of closed streams, and libraries would write to them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Also for child processes, such as the one in which glfw looks for its library.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")
    cast(TextIOWrapper, sys.stdout).reconfigure(errors="backslashreplace")

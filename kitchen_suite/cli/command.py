"""The one `main` of all commands: it parses, prepares a job, runs it, and reports every problem in one line."""

import contextlib
import dataclasses
import functools
import pkgutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from absl import flags

import kitchen_suite
from kitchen_suite import checks
from kitchen_suite.cli import process
from kitchen_suite.cli.flag_parsing import define_flags
from kitchen_suite.cli.options import OPTIONS, RENAMED
from kitchen_suite.rendering import gl

SUCCESS, FAILURE, USAGE, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141

_WIDTH = 100  # Characters in a line of the help.
_MAX_MESSAGE = 1000  # Characters of an error, which may quote any argument.

# Flags that show the help in other programs: `-?` on Windows, the others in absl's.
_HELP_FLAGS = ("?", "helpfull", "helpshort")


class Job(Protocol):
    """A command's work, prepared so that bad arguments have been refused.

    Attributes:
      failures: exceptions of `run` that end the command with `FAILURE`.
      usage_errors: those that end it with `USAGE`.
    """

    failures: tuple[type[Exception], ...]
    usage_errors: tuple[type[Exception], ...]

    def run(self) -> bool:
        """Does the work; returns whether it succeeded."""

    def progress(self) -> str:
        """Returns how far the work came, for the line that reports an interrupt."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Command:
    """A console script.

    Attributes:
      name: name of the script.
      description: text above the flags in `--help`.
      settings: dataclass of the command's settings; each field is a flag, those without a default are required.
      job: `module:callable` that returns a `Job` for the settings. The module is imported after the GL library has been
        chosen, since dm_control chooses one when it is imported.
      renders: whether pictures will be rendered with given settings; None where the job will find out.
      positional: the field that is given without a flag, if any.
      needs: packages that the job imports, and the extra that installs them.
    """

    name: str
    description: str | None
    settings: type
    job: str
    renders: Callable[[Any], bool | None] = lambda settings: False
    positional: str | None = None
    needs: tuple[tuple[str, ...], str] = ((), "")

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Runs the command.

        Args:
          arguments: the command line without the program's name; by default that of this process.

        Returns:
          The exit status.
        """
        try:
            settings = self._parse(sys.argv[1:] if arguments is None else arguments)
            with process.interrupts_prevail():
                job = None if isinstance(settings, str) else self._prepare(settings)
        except KeyboardInterrupt:
            return self._fail("interrupted", INTERRUPTED)
        except (flags.Error, ImportError, OSError, TypeError, ValueError) as error:
            return self._fail(error, USAGE)
        if job is None:
            print(settings)
            return SUCCESS
        return self._run(job)

    def console_main(self) -> int:
        """Runs the command as a process of its own; returns the exit status."""
        process.open_closed_streams()
        process.raise_interrupts()
        process.shorten_warnings()
        status = SUCCESS
        try:
            status = self.main()
            sys.stdout.flush()
        except KeyboardInterrupt:
            return self._fail("interrupted", INTERRUPTED)
        except BrokenPipeError:
            # The reader of the output has left.
            process.discard_stdout()
            return BROKEN_PIPE
        except OSError as error:
            process.discard_stdout()
            return status or self._fail(f"stdout cannot be written to: {error}", FAILURE)
        return status

    @functools.cached_property
    def _flags(self) -> flags.FlagValues:
        return define_flags(self.settings, exclude=self.positional)

    def _parse(self, arguments: Sequence[str]) -> Any:
        """Returns the settings, or the text that `--help` or `--version` asks for.

        Raises:
          flags.Error: a flag is unknown, missing or has a bad value, or there are too many other arguments.
        """
        values = self._flags
        values.unparse_flags()
        _, *rest = values([self.name, *arguments], known_only=True)
        rest = [text for text in rest if text != "--"]
        # absl would take the flags that --undefok names for known ones.
        undefok = [text for text in arguments if _flag_name(text) == "undefok"]
        unknown = [name for name in map(_flag_name, [*undefok, *rest]) if name]
        if values.help or (unknown and unknown[0] in _HELP_FLAGS):
            return self._help()
        if values.version:
            return f"{self.name} {kitchen_suite.__version__}"
        if unknown:
            raise flags.Error(self._describe_unknown(unknown[0]))
        chosen = {field.name: values[field.name].value for field in self._fields if field.name != self.positional}
        if self.positional and rest:
            chosen[self.positional], *rest = rest
        if rest:
            raise flags.Error(f"unexpected argument {rest[0]!r}: all others are flags, see --help")
        for field in self._fields:
            if chosen.get(field.name) is None and _is_required(field):
                flag = "" if field.name == self.positional else "--"
                raise flags.Error(f"{flag}{field.name} is missing: {OPTIONS[field.name].help}")
        return self.settings(**chosen)

    def _prepare(self, settings: Any) -> Job:
        packages, extra = self.needs
        checks.installed(packages, self.name, extra)
        gl.prepare(rendering=self.renders(settings))
        return pkgutil.resolve_name(self.job)(settings)

    def _run(self, job: Job) -> int:
        try:
            with process.interrupts_prevail():
                return SUCCESS if job.run() else FAILURE
        except KeyboardInterrupt:
            return self._fail(f"interrupted {job.progress()}", INTERRUPTED)
        except BrokenPipeError:
            raise
        except job.usage_errors as error:
            return self._fail(error, USAGE)
        except job.failures as error:
            return self._fail(error, FAILURE)

    def _fail(self, problem: object, status: int) -> int:
        """Reports a problem in one line on stderr, if that can be written to; returns the exit status."""
        with contextlib.suppress(OSError):
            print(f"{self.name}:", _one_line(str(problem)), file=sys.stderr)
        return status

    def _describe_unknown(self, flag: str) -> str:
        """Returns the error for a flag that does not exist, with the one that may be meant."""
        names = [name for name in OPTIONS if name in self._flags]
        meant = RENAMED.get(flag)
        near = meant if meant in names else checks.nearest(flag, names)
        hint = f" (did you mean --{near}?)" if near else ""
        return f"there is no flag --{flag}{hint}; --help lists all"

    @property
    def _fields(self) -> tuple[dataclasses.Field, ...]:
        return dataclasses.fields(self.settings)

    def _help(self) -> str:
        """Returns the description and all flags in the order of `OPTIONS`."""
        names = {*self._flags, self.positional}
        rows = [self._help_of(name) for name in OPTIONS if name in names]
        return "\n".join([self.description or "", "Flags:", *rows])

    def _help_of(self, name: str) -> str:
        required = {field.name for field in self._fields if _is_required(field)}
        default = None if name in required else self._flags[name].default
        unset = {field.name: field.metadata.get("unset") for field in self._fields}.get(name) or OPTIONS[name].unset
        ending = "Required." if name in required else _default_text(default, unset)
        text = f"{OPTIONS[name].help} {ending}".rstrip()
        first = f"  {name.upper():<21} " if name == self.positional else f"  --{name:<19} "
        return textwrap.fill(text, _WIDTH, initial_indent=first, subsequent_indent=" " * 24, break_on_hyphens=False)


def _flag_name(text: str) -> str:
    """Returns the name of a flag on the command line; empty for other arguments."""
    return text.lstrip("-").partition("=")[0] if text.startswith("-") else ""


def _one_line(text: str) -> str:
    """Returns a text in one line, without the middle of a very long one."""
    line = " ".join(text.split())
    half = _MAX_MESSAGE // 2
    return line if len(line) <= _MAX_MESSAGE else f"{line[:half]} (shortened) {line[-half:]}"


def _is_required(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _default_text(default: Any, unset: str) -> str:
    """Returns the sentence on a flag's default, or on what applies without the flag; empty where there is neither."""
    if default is None or default in ((), {}):
        return f"Default: {unset}." if unset else ""
    if default is False:
        return ""
    return f"Default: {','.join(map(str, default)) if isinstance(default, tuple) else default}."

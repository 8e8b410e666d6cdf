"""Programs that check their arguments in place of doing their work: python tests/stand_ins.py PROGRAM ARGUMENT ...

pip          all requirements are installed, in versions that match; extras of the suite are those of setup.cfg
kitchen-*    the command parses its arguments
others       arguments that end with .py are files of the repository
"""

import configparser
import importlib
import importlib.metadata
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent


def suite_requirements(extras: Sequence[str] = ()) -> Iterator[Requirement]:
    """Yields what the suite needs according to setup.cfg, and what its extras need.

    Raises:
      KeyError: there is no such extra.
    """
    setup = configparser.ConfigParser(comment_prefixes=("#",), interpolation=None)
    setup.read(ROOT / "setup.cfg", encoding="utf-8")
    groups = [setup["options"]["install_requires"], *(setup["options.extras_require"][extra] for extra in extras)]
    for requirement in (Requirement(line) for group in groups for line in group.strip().splitlines()):
        if requirement.name == "kitchen-suite":
            yield from suite_requirements(sorted(requirement.extras))
        elif requirement.name != "labmaze":  # It is there to stop pip on Python 3.13.
            yield requirement


def named_requirements(arguments: Sequence[str]) -> Iterator[Requirement]:
    """Yields the requirements that a command line of pip names; `.` is the suite, a folder the project of its name."""
    for argument in arguments:
        if argument.startswith("."):
            argument = f"kitchen-suite{argument[1:]}"
        elif (ROOT / argument / "pyproject.toml").is_file():
            argument = Path(argument).name
        if not argument.startswith("-"):
            yield Requirement(argument)


def check_pip(command: str, *arguments: str) -> None:
    if command != "install":
        sys.exit(f"pip {command}: only installations are checked")
    for requirement in named_requirements(arguments):
        is_suite = requirement.name == "kitchen-suite"
        for needed in suite_requirements(sorted(requirement.extras)) if is_suite else [requirement]:
            try:
                installed = importlib.metadata.version(needed.name)
            except importlib.metadata.PackageNotFoundError:
                sys.exit(f"{needed} is not installed here")
            if not needed.specifier.contains(installed, prereleases=True):
                sys.exit(f"{needed} does not match the installed version {installed}")


def check_command(name: str, *arguments: str) -> None:
    commands = importlib.import_module("kitchen_suite.commands")
    if name == "kitchen-suite":
        name, *arguments = arguments or ["--help"]
        if name.startswith("-"):
            return
    commands.find(name.removeprefix("kitchen-")).parse(arguments)


def check_files(*arguments: str) -> None:
    missing = [argument for argument in arguments if argument.endswith(".py") and not (ROOT / argument).is_file()]
    if missing:
        sys.exit(f"there is no file {missing[0]}")


def main(program: str, *arguments: str) -> None:
    if program == "pip":
        check_pip(*arguments)
    elif program.startswith("kitchen-"):
        check_command(program, *arguments)
    else:
        check_files(*arguments)


if __name__ == "__main__":
    main(*sys.argv[1:])

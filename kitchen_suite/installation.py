"""How the suite and its extras are installed: what is missing, and the command of pip that adds it."""

import importlib.util
import sys
from collections.abc import Iterable, Mapping

# Python that extras need, where it is a newer one than the suite's own.
EXTRA_PYTHONS: Mapping[str, tuple[int, int]] = {"lerobot": (3, 12)}

# Packages that an extra installs, by the name of the extra, of which an error says that they are missing.
EXTRA_PACKAGES = {"experts": ("daqp", "mink"), "remote": ("msgpack", "websockets")}

_DISTRIBUTION = "kitchen-suite"


def installed(packages: Iterable[str], what: str, extra: str) -> None:
    """Raises a ModuleNotFoundError with the command that installs an extra if `what` needs packages that it lacks."""
    if missing := [name for name in packages if not importlib.util.find_spec(name)]:
        raise ModuleNotFoundError(f"{what} needs {' and '.join(missing)}: {install_command(extra)}")


def version_of(package: str) -> str | None:
    """Returns the version of a package; None if it is not installed."""
    import importlib.metadata  # A tenth of the time that the suite takes to be imported.

    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def install_command(extra: str) -> str:
    """Returns the pip command that adds an extra to the installed suite, wherever that was installed from.

    It begins with the Python that the extra needs, where this one is older.
    """
    command = f"pip install '{_DISTRIBUTION}[{extra}]'"
    python = EXTRA_PYTHONS.get(extra, (0, 0))
    if sys.version_info < python:
        return f"with Python {python[0]}.{python[1]}, not {sys.version_info[0]}.{sys.version_info[1]}, {command}"
    return command

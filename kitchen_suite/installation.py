"""How the suite and its extras are installed: what is missing, and the command of pip that adds it."""

import contextlib
import importlib.util
import json
import shlex
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

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
    """Returns the pip command that installs an extra of the suite from where the suite was installed.

    It begins with the Python that the extra needs, where this one is older.
    In a checkout it is `pip install '.[video]'`, elsewhere for example `pip install -e '/home/me/suite[video]'`.
    """
    command = f"pip install {_requirement(extra)}"
    python = EXTRA_PYTHONS.get(extra, (0, 0))
    if sys.version_info < python:
        return f"with Python {python[0]}.{python[1]}, not {sys.version_info[0]}.{sys.version_info[1]}, {command}"
    return command


def _requirement(extra: str) -> str:
    """Returns what pip installs an extra from, with its options, quoted for a shell."""
    # Together a fifth of the time that the suite takes to be imported.
    import importlib.metadata
    import urllib.parse
    import urllib.request

    source = None
    with contextlib.suppress(importlib.metadata.PackageNotFoundError, ValueError):
        # The source that pip has recorded, by PEP 610.
        source = json.loads(importlib.metadata.distribution(_DISTRIBUTION).read_text("direct_url.json") or "null")
    checkout = Path(__file__).resolve().parent.parent
    if not source and (checkout / "setup.cfg").is_file():
        source = {"url": checkout.as_uri(), "dir_info": {"editable": True}}
    if not source:
        return shlex.quote(f"{_DISTRIBUTION}[{extra}]")
    if "dir_info" in source:
        folder = Path(urllib.request.url2pathname(urllib.parse.urlsplit(source["url"]).path))
        if folder == Path.cwd():
            return f"'.[{extra}]'"
        return ("-e " if source["dir_info"].get("editable") else "") + shlex.quote(f"{folder}[{extra}]")
    vcs = source.get("vcs_info")
    url = f"{vcs['vcs']}+{source['url']}@{vcs['commit_id']}" if vcs else source["url"]
    return shlex.quote(f"{_DISTRIBUTION}[{extra}] @ {url}")

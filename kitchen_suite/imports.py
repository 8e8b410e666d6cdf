"""Objects that are imported by a name `module:NAME`, which a person or a program has given.

Files, such as recordings, name no code: what they name has to have been named here before, or is refused. So the
working directory is never searched for a file's sake.
"""

import pkgutil
import re
import sys
from pathlib import Path
from typing import Any

from kitchen_suite import checks

# The file of a module in place of its name, with the name of an object or without.
_FILE_OF_A_MODULE = re.compile(r"(?P<path>.+)\.py(:(?P<name>\w*))?")

_named: set[str] = set()


def named(name: str, what: str) -> Any:
    """Returns the object `module:name`, also from the working directory; the ValueError of no such one names `what`.

    From then on files may name it as well.
    """
    check_no_file(name, what)
    # Unlike `python -m`, console scripts do not look there. Last, so that it hides no installed module.
    if (directory := str(Path.cwd())) not in sys.path:
        sys.path.append(directory)
    try:
        found = pkgutil.resolve_name(name)
    except (Exception, SystemExit) as error:  # Importing runs the code of the module.
        problem = checks.shortened(f"{type(error).__name__}: {error}", 500)
        raise ValueError(f"{what} {checks.shown(name)} cannot be imported: {problem}") from error
    _named.add(name)
    return found


def check_no_file(name: str, what: str) -> None:
    """Raises a ValueError for the file of a module in place of its name."""
    if match := _FILE_OF_A_MODULE.fullmatch(name):
        path = Path(match["path"])
        module = path.name if path.is_absolute() or ".." in path.parts else ".".join(path.parts)
        folder = "" if module != path.name or path.parent == Path() else ", from the folder of the file"
        meant = f"{module}:{match['name'] or 'NAME'}"
        raise ValueError(f"{what} {checks.shown(name)} is a file: name its module, without .py, as {meant}{folder}")


def check_named(name: object, what: str) -> None:
    """Raises a ValueError for what a file names as `module:NAME`, unless `named` has returned it in this process."""
    if isinstance(name, str) and ":" in name and name not in _named:
        raise ValueError(
            f"the {what} {checks.shown(name)} is code of somebody's own, which is not imported because a file names "
            "it: name it yourself, as custom"
        )

"""When the committed results were made, and with which versions.

python docs/scripts/dates.py   dates the results that have changed since: today, with the versions that are installed

`docs/experiments/results/dates.json` has the date, the versions and a digest of each file or folder of results.
"""

import datetime
import hashlib
import json
from pathlib import Path
from typing import Any

from experiment import RESULTS, make_parser

from kitchen_suite.versions import installed_versions

DATES = RESULTS / "dates.json"

# Packages whose versions are kept: those that the physics depends on.
PACKAGES = ("kitchen-suite", "dm-control", "mujoco", "numpy")


def digest(path: Path) -> str:
    """Returns the SHA-256 of a file, or of the names and contents of the files of a folder."""
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    found = hashlib.sha256()
    for file in sorted(each for each in path.rglob("*") if each.is_file()):
        found.update(f"{file.relative_to(path).as_posix()} {digest(file)}\n".encode())
    return found.hexdigest()


def digests() -> dict[str, str]:
    """Returns the digests of all results, by the names of their files and folders."""
    return {path.name: digest(path) for path in sorted(RESULTS.iterdir()) if path != DATES}


def read_dates() -> dict[str, dict[str, Any]]:
    """Returns the date, versions and digest of each result."""
    dates: dict[str, dict[str, Any]] = json.loads(DATES.read_text(encoding="utf-8"))
    return dates


def main() -> None:
    """Runs the command."""
    make_parser(__doc__).parse_args()
    versions = installed_versions()
    now = {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {name: versions[name] for name in PACKAGES},
    }
    known = read_dates()
    dates = {}
    for name, found in digests().items():
        unchanged = name in known and known[name]["sha256"] == found
        dates[name] = known[name] if unchanged else {**now, "sha256": found}
    DATES.write_text(json.dumps(dates, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

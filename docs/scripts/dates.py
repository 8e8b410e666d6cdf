"""When the committed results were made, and with which versions.

python docs/scripts/dates.py   dates the results that have changed since: today, with the versions that are installed

`docs/experiments/results/dates.json` has the date, the versions and a digest of each file of results. Where a file has
versions of its own, as evaluations and receipts have, these are taken.
"""

import datetime
import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from experiment import RESULTS, make_parser

from kitchen_suite.evaluation.receipt import Receipt
from kitchen_suite.versions import installed_versions

DATES = RESULTS / "dates.json"

# Packages whose versions are kept: those that the physics depends on.
PACKAGES = ("kitchen-suite", "dm-control", "mujoco", "numpy")


def results() -> Iterator[Path]:
    """Yields the files of results."""
    for path in sorted(RESULTS.rglob("*")):
        if path.suffix in {".json", ".npz"} and path != DATES:
            yield path


def name_of(path: Path) -> str:
    """Returns the name of a file of results: its path in the folder of results."""
    return path.relative_to(RESULTS).as_posix()


def digests() -> dict[str, str]:
    """Returns the SHA-256 of each file of results, by its name."""
    return {name_of(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in results()}


def recorded_versions(path: Path) -> Mapping[str, str] | None:
    """Returns the versions that a file says it was made with; None if it has none."""
    if path.suffix == ".npz":
        found: Mapping[str, str] = Receipt.read(path).evaluation["versions"]
        return found
    content = json.loads(path.read_text(encoding="utf-8"))
    return content.get("versions") if isinstance(content, dict) else None


def read_dates() -> dict[str, dict[str, Any]]:
    """Returns the date, versions and digest of each file of results, by its name."""
    dates: dict[str, dict[str, Any]] = json.loads(DATES.read_text(encoding="utf-8"))
    return dates


def main() -> None:
    """Runs the command."""
    make_parser(__doc__).parse_args()
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    installed = installed_versions()
    found = digests()
    known = read_dates()
    dates = {}
    for path in results():
        name = name_of(path)
        if name in known and known[name]["sha256"] == found[name]:
            dates[name] = known[name]
        else:
            versions = {**installed, **(recorded_versions(path) or {})}
            kept = {package: versions[package] for package in PACKAGES}
            dates[name] = {"date": today, "versions": kept, "sha256": found[name]}
    DATES.write_text(json.dumps(dates, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""Goes through the checklist of a release.

python .ci/release.py [STEP ...]

Without steps, all of them in their order. Every step prints what it found; the exit status is 1 if any found a problem.
Environments are made in a temporary folder; the sdist and the wheel are left in `dist/`.
"""

import argparse
import configparser
import itertools
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

# Extras that need a newer Python than the suite; pip is not asked about them with an older one.
NEWER_PYTHONS: Mapping[str, tuple[int, int]] = {"lerobot": (3, 12)}

# As https://keepachangelog.com has them, such as `## [1.0.0] - 2026-11-27`.
_HEADING = re.compile(r"^## \[(\S+)\] - (\S+)$", re.MULTILINE)
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")
# Of the shipped files, those that are easily forgotten.
_IN_WHEEL = ("py.typed", ".npz", ".xml", "LICENSE", "NOTICE")
_IN_SDIST = (*_IN_WHEEL, "setup.cfg", "pyproject.toml", "README.md")
_LEFT_TO_THE_OWNER = "All steps passed; docs/development/releasing.md has what is done by hand."


class ReleaseError(Exception):
    """A step found something that a release must not have."""


def version(root: Path = ROOT) -> str:
    """Returns the version of the package, without importing it."""
    text = (root / "kitchen_suite" / "_version.py").read_text(encoding="utf-8")
    found = re.search(r'^__version__ = "(.+)"$', text, re.MULTILINE)
    if not found:
        raise ReleaseError("kitchen_suite/_version.py has no __version__")
    return found[1]


def check_version(root: Path = ROOT) -> str:
    """Checks that CITATION.cff has the version of the package, that it is not tagged, and that all is committed."""
    number = version(root)
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    if f"\nversion: {number}\n" not in citation:
        raise ReleaseError(f"CITATION.cff does not have the version {number}")
    if _git(root, "tag", "--list", f"v{number}"):
        raise ReleaseError(f"there is a tag v{number} already: choose the next version")
    if changed := _git(root, "status", "--porcelain"):
        raise ReleaseError(f"not committed:\n{changed}")
    return number


def check_changelog(root: Path = ROOT) -> str:
    """Checks that the newest entry of CHANGELOG.md is that of the version, with its date."""
    found = _HEADING.search((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    if not found or found[1] != version(root):
        raise ReleaseError(f"the newest heading of CHANGELOG.md is not that of {version(root)}")
    if not _DATE.fullmatch(found[2]):
        raise ReleaseError(f"CHANGELOG.md: {found[1]} has no date, such as 2027-01-31, but {found[2]!r}")
    return found[0]


def build_distributions(root: Path = ROOT) -> str:
    """Builds the sdist, and the wheel from it, and checks that they are complete."""
    for old in (root / "dist").glob("*"):
        old.unlink()
    _run(sys.executable, "-m", "build", "--quiet", "--outdir", str(root / "dist"), str(root))
    sdist, wheel = _distributions(root)
    with tarfile.open(sdist) as archive:
        _check_contents(sdist, archive.getnames(), _IN_SDIST)
    with zipfile.ZipFile(wheel) as archive:
        _check_contents(wheel, archive.namelist(), _IN_WHEEL)
    return f"{sdist.name}, {wheel.name}"


def try_distributions(root: Path = ROOT) -> str:
    """Installs the wheel and the sdist, each in an empty environment, and plays an episode in another folder."""
    for distribution in _distributions(root):
        with tempfile.TemporaryDirectory() as folder:
            programs = _environment(Path(folder), str(distribution))
            _run(str(programs / "kitchen-rollout"), "--num_episodes=1", "--max_episode_steps=25", folder=folder)
            _run(str(programs / "python"), "-c", "import kitchen_suite.entities, kitchen_suite.tasks", folder=folder)
    return "both play an episode"


def build_site(root: Path = ROOT) -> str:
    """Builds the documentation in an environment of its own."""
    _run("bash", str(root / ".ci" / "stage"), "site", SITE=str(root / "site"))
    return "site/index.html"


def check_extras(root: Path = ROOT) -> str:
    """Checks by pip's resolver that all extras can be installed together."""
    names = extras(root)
    if _resolves(root, names):
        return f"together: {', '.join(names)}"
    pairs = itertools.combinations(sorted(names), 2)
    if refused := [" and ".join(pair) for pair in pairs if not _resolves(root, [*pair])]:
        raise ReleaseError(f"cannot be installed together: {'; '.join(refused)}")
    raise ReleaseError(f"{', '.join(names)} cannot be installed together, though any two of them can")


def extras(root: Path = ROOT) -> list[str]:
    """Returns the names of the extras in setup.cfg."""
    setup = configparser.RawConfigParser()
    setup.read(root / "setup.cfg", encoding="utf-8")
    return list(setup["options.extras_require"])


STEPS: Mapping[str, Callable[[], str]] = {
    "version": check_version,
    "changelog": check_changelog,
    "build": build_distributions,
    "try": try_distributions,
    "docs": build_site,
    "extras": check_extras,
}


def _resolves(root: Path, names: list[str]) -> bool:
    """Returns whether pip finds versions for some extras together; nothing is installed."""
    names = [name for name in names if sys.version_info >= NEWER_PYTHONS.get(name, (3, 0))]
    command = (sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet")
    return subprocess.run([*command, f"{root}[{','.join(names)}]"], capture_output=True, check=False).returncode == 0


def _distributions(root: Path) -> tuple[Path, Path]:
    found = [[*(root / "dist").glob(f"kitchen_suite-{version(root)}{ending}")] for ending in (".tar.gz", "-*.whl")]
    if not all(found):
        raise ReleaseError("dist/ has no sdist and wheel of this version: run the step `build` first")
    return found[0][0], found[1][0]


def _check_contents(archive: Path, names: list[str], endings: tuple[str, ...]) -> None:
    if missing := [ending for ending in endings if not any(name.endswith(ending) for name in names)]:
        raise ReleaseError(f"{archive.name} has no {', '.join(missing)}")


def _environment(folder: Path, requirement: str) -> Path:
    """Makes an environment in which a requirement is installed; returns the folder of its programs."""
    venv.create(folder / "venv", with_pip=True)
    programs = folder / "venv" / "bin"
    _run(str(programs / "python"), "-m", "pip", "install", "--quiet", requirement, folder=str(folder))
    return programs


def _git(root: Path, *arguments: str) -> str:
    return _run("git", "-C", str(root), *arguments).strip()


def _run(*command: str, folder: str | None = None, **variables: str) -> str:
    """Runs a command without the variables that lead Python to this checkout, and with others; returns its output.

    Raises:
      ReleaseError: it failed; with its output.
    """
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    environment |= variables
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ReleaseError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


def main(arguments: list[str]) -> int:
    """Goes through the steps; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=f"one of {', '.join(STEPS)}")
    parser.add_argument("--version", action="version", version=version(), help="print the version of the package")
    chosen = parser.parse_args(arguments).steps or list(STEPS)
    if unknown := [name for name in chosen if name not in STEPS]:
        parser.error(f"there is no step {unknown[0]!r}; choose from {', '.join(STEPS)}")
    failures = 0
    for name in chosen:
        try:
            print(f"[ok] {name}: {STEPS[name]()}", flush=True)
        except ReleaseError as problem:
            failures += 1
            print(f"[FAILED] {name}: {problem}", flush=True)
    print(f"{failures} of {len(chosen)} steps failed" if failures else _LEFT_TO_THE_OWNER)
    return min(failures, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

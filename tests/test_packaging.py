"""The lists in setup.cfg are complete."""

import configparser
import re
import subprocess
import sys
from pathlib import Path

import pytest

import kitchen_suite
from kitchen_suite.rollouts.rollout_job import _DEFAULT_VIDEO

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {"kitchen_suite": "kitchen_suite", "kitchen_suite.entities": "entities", "kitchen_suite.tasks": "tasks"}
# Installed beside the package, so that its import is that of no other module.
CONSOLE = "kitchen_suite_console", "kitchen_suite/console"


@pytest.fixture(scope="module")
def setup():
    parser = configparser.RawConfigParser()
    parser.read(ROOT / "setup.cfg", encoding="utf-8")
    return parser


def test_packages_are_the_folders_with_an_init(setup):
    found = {
        ".".join((package, *path.parent.relative_to(ROOT / folder).parts))
        for package, folder in FOLDERS.items()
        for path in (ROOT / folder).rglob("__init__.py")
    }
    name, folder = CONSOLE
    assert set(setup["options"]["packages"].split()) == {*found, name} - {folder.replace("/", ".")}


def test_every_data_file_is_shipped(setup):
    shipped = {
        path
        for package, patterns in setup["options.package_data"].items()
        for pattern in patterns.split()
        for path in folder_of(package).glob(pattern)
    }
    for folder in FOLDERS.values():
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix not in {".py", ".pyc"}:
                assert path in shipped, path


def folder_of(package):
    """The folder that a package is installed from: that of the longest name in `package_dir`, and what is below it."""
    owner = max((name for name in FOLDERS if f"{package}.".startswith(f"{name}.")), key=len)
    return ROOT / FOLDERS[owner] / package.removeprefix(owner).replace(".", "/").lstrip("/")


def test_the_version_is_the_changelogs_newest(setup):
    assert setup["metadata"]["version"] == "attr: kitchen_suite.__version__"
    headings = [line for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines() if line[:3] == "## "]
    assert headings[0].startswith(f"## {kitchen_suite.__version__}")


def test_every_extra_that_is_spoken_of_exists(setup):
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "setup.cfg", ROOT / ".ci" / "run"]
    extras = {
        extra
        for page in pages
        for named in re.findall(r"(?:kitchen-suite|'\.)\[([\w,]+)\]", page.read_text(encoding="utf-8"))
        for extra in named.split(",")
    }
    assert extras <= set(setup["options.extras_require"])
    assert {"video", "test", "clients"} <= extras


def test_test_files_have_unique_names():
    names = [path.name for path in (ROOT / "tests").rglob("*.py")]
    assert len(names) == len(set(names))


def test_importing_the_suite_neither_registers_nor_prints():
    code = "import sys, kitchen_suite.suite; assert 'gymnasium_robotics' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_suite_adds_no_filters_of_warnings():
    code = (
        "import warnings, gymnasium, scipy.special\n"
        "from dm_control import composer\n"
        "before = [*warnings.filters]\n"
        "import kitchen_suite\n"
        "env = gymnasium.make('KitchenSuite/FrankaMicrowaveTable-v1')\n"
        "env.reset(seed=0), env.step(env.action_space.sample())\n"
        "assert warnings.filters == before"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True, cwd=ROOT)


def test_the_default_video_is_not_committed():
    assert f"/{_DEFAULT_VIDEO}" in ROOT.joinpath(".gitignore").read_text().splitlines()

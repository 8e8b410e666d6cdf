"""The packages, files and extras that setup.cfg installs, and the version."""

import configparser
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

import kitchen_suite
from kitchen_suite.commands.play import _DEFAULT_VIDEO

ROOT = Path(__file__).resolve().parent.parent
LINKS = ("entities", "tasks")


@pytest.fixture(scope="module")
def setup():
    parser = configparser.RawConfigParser()
    parser.read(ROOT / "setup.cfg", encoding="utf-8")
    return parser


@pytest.mark.full
def test_every_file_of_the_package_is_shipped(tmp_path):
    # Without `build`, from which setuptools would take files that are no longer in the tree.
    tree = tmp_path / "tree"
    shutil.copytree(ROOT, tree, symlinks=True, ignore=shutil.ignore_patterns("build", "outputs", ".*", "__pycache__"))
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--wheel-dir", str(tmp_path), str(tree)]
    subprocess.run(command, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    shipped = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("kitchen_suite/")}
    # Links are not followed, but where they are the folder to start from.
    folders = [tree / "kitchen_suite", *(tree / "kitchen_suite" / link / "" for link in LINKS)]
    files = {path for folder in folders for path in folder.rglob("*") if path.is_file()}
    assert shipped == {path.relative_to(tree).as_posix() for path in files}


def test_the_packages_at_the_top_are_links_in_the_package():
    for name in LINKS:
        assert (ROOT / "kitchen_suite" / name).readlink() == Path("..") / name


def test_the_version_is_the_changelogs_newest(setup):
    assert setup["metadata"]["version"] == "attr: kitchen_suite._version.__version__"
    headings = [line for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines() if line[:3] == "## "]
    assert headings[0] == "## [Unreleased]"
    assert headings[1].startswith(f"## [{kitchen_suite.__version__}] - ")


def test_pip_is_stopped_by_a_version_of_labmaze_that_names_the_page_where_uv_leaves_labmaze_out(setup):
    first = Requirement(setup["options"]["install_requires"].strip().splitlines()[0])
    (specifier,) = first.specifier
    page = specifier.version.partition("+see.")[2]
    # PyPI takes no local versions, so that nobody can offer this one.
    assert first.name == "labmaze"
    assert Version(specifier.version).local
    assert (ROOT / page.removesuffix(".md").replace(".", "/")).with_suffix(".md").is_file()
    with (ROOT / "pyproject.toml").open("rb") as file:
        (override,) = map(Requirement, tomllib.load(file)["tool"]["uv"]["override-dependencies"])
    assert override.name == "labmaze"
    for python in ("3.11", "3.12", "3.13", "3.14"):
        assert first.marker.evaluate({"python_version": python}) is not override.marker.evaluate(
            {"python_version": python}
        )


def test_every_extra_that_is_spoken_of_exists(setup):
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "setup.cfg", ROOT / ".ci" / "stage"]
    extras = {
        extra
        for page in pages
        for named in re.findall(r"(?:kitchen-suite|'\.)\[([\w,]+)\]", page.read_text(encoding="utf-8"))
        for extra in named.split(",")
    }
    assert extras <= set(setup["options.extras_require"])
    assert {"video", "test", "web"} <= extras


def test_test_files_have_unique_names():
    names = [path.name for path in (ROOT / "tests").rglob("*.py") if path.name != "conftest.py"]
    assert len(names) == len(set(names))


@pytest.mark.full
def test_importing_the_suite_neither_registers_nor_prints():
    code = "import sys, kitchen_suite.suite; assert 'gymnasium_robotics' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.full
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

"""The checklist of a release, `.ci/release.py`, and the files that it compares."""

import importlib.util
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import kitchen_suite

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def release():
    spec = importlib.util.spec_from_file_location("release", ROOT / ".ci" / "release.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def repository(tmp_path):
    """A committed repository that is ready to be released."""
    (tmp_path / "kitchen_suite").mkdir()
    (tmp_path / "kitchen_suite" / "_version.py").write_text('"""The version."""\n\n__version__ = "1.2.3"\n')
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## [1.2.3] - 2027-01-31\n\n- All.\n\n## [1.2.2] - 2026-12-31\n"
    )
    (tmp_path / "CITATION.cff").write_text("title: Kitchen Suite\nversion: 1.2.3\nlicense: Apache-2.0\n")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message=all")
    return tmp_path


def git(folder, *arguments):
    identity = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "core.hooksPath=/dev/null")
    subprocess.run(["git", *identity, *arguments], cwd=folder, check=True)


def test_a_repository_that_is_ready_passes(release, repository):
    assert release.check_version(repository) == "1.2.3"
    assert release.check_changelog(repository) == "## [1.2.3] - 2027-01-31"


def test_a_version_that_is_tagged_already_is_a_problem(release, repository):
    git(repository, "tag", "v1.2.3")
    with pytest.raises(release.ReleaseError, match=r"there is a tag v1.2.3 already"):
        release.check_version(repository)


def test_an_uncommitted_file_is_a_problem(release, repository):
    (repository / "more.txt").touch()
    with pytest.raises(release.ReleaseError, match=r"(?s)not committed:.*more\.txt"):
        release.check_version(repository)


def test_a_citation_of_another_version_is_a_problem(release, repository):
    (repository / "CITATION.cff").write_text("title: Kitchen Suite\nversion: 1.2.2\n")
    with pytest.raises(release.ReleaseError, match=r"CITATION.cff does not have the version 1.2.3"):
        release.check_version(repository)


@pytest.mark.parametrize(
    ("heading", "message"), [("[1.2.3] - unreleased", "no date"), ("[1.2.2] - 2026-12-31", "newest heading")]
)
def test_a_changelog_without_the_version_or_its_date_is_a_problem(release, repository, heading, message):
    (repository / "CHANGELOG.md").write_text(f"# Changelog\n\n## {heading}\n")
    with pytest.raises(release.ReleaseError, match=message):
        release.check_changelog(repository)


def test_distributions_that_miss_a_file_are_a_problem(release):
    with pytest.raises(release.ReleaseError, match=r"a.whl has no \.npz, NOTICE"):
        release._check_contents(Path("a.whl"), ["a/py.typed", "a/x.xml", "a/LICENSE"], release._IN_WHEEL)


def test_trying_before_building_is_a_problem(release, repository):
    with pytest.raises(release.ReleaseError, match="run the step `build` first"):
        release.try_distributions(repository)


def refuse(release, monkeypatch, *conflicts):
    """Lets pip's resolver refuse what contains a pair of extras."""
    pairs = [set(pair) for pair in conflicts]
    monkeypatch.setattr(release, "_resolves", lambda root, names: not any(pair <= set(names) for pair in pairs))


def test_a_conflict_of_extras_is_named(release, monkeypatch):
    refuse(release, monkeypatch, ("ray", "web"))
    with pytest.raises(release.ReleaseError, match=r"cannot be installed together: ray and web$"):
        release.check_extras()


def test_extras_that_pip_can_install_together_pass(release, monkeypatch):
    refuse(release, monkeypatch)
    assert release.check_extras() == f"together: {', '.join(release.extras())}"


def test_the_exit_status_counts_problems(release, monkeypatch, capsys):
    def fail():
        raise release.ReleaseError("no such thing")

    monkeypatch.setattr(release, "STEPS", {"first": lambda: "done", "second": fail})
    assert release.main([]) == 1
    assert capsys.readouterr().out == "[ok] first: done\n[FAILED] second: no such thing\n1 of 2 steps failed\n"
    assert release.main(["first"]) == 0
    with pytest.raises(SystemExit) as stop:
        release.main(["third"])
    assert stop.value.code == 2


def test_the_citation_has_the_version_of_the_package(release):
    assert release.version() == kitchen_suite.__version__
    assert f"\nversion: {kitchen_suite.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_hooks_run_the_commands_of_the_checks():
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    checks = (ROOT / ".ci" / "stage").read_text(encoding="utf-8")
    for command, arguments in (
        ("ruff check", " ."),
        ("ruff format", " --check ."),
        ("mypy kitchen_suite", ""),
    ):
        assert command in hooks
        assert f"{command}{arguments}" in checks


def stages():
    """Returns the names of the stages, as `.ci/stage` lists them."""
    listed = subprocess.run(["bash", str(ROOT / ".ci" / "stage")], capture_output=True, text=True, check=False)
    assert listed.returncode == 2
    return {*listed.stderr.split("one of ")[1].split()}


def run_with(stage, folder, commits):
    """Returns the exit status and the lines of `.ci/run` after so many commits; `stage` is the script `.ci/stage`."""
    (folder / ".ci").mkdir(parents=True)
    (folder / "bin").mkdir()
    shutil.copy(ROOT / ".ci" / "run", folder / ".ci")
    (folder / ".ci" / "stage").write_text(stage, encoding="utf-8")
    (folder / "bin" / "git").write_text(f"#!/bin/sh\necho {commits}\n", encoding="utf-8")
    (folder / "bin" / "git").chmod(0o755)
    path = f"{folder / 'bin'}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", folder / ".ci" / "run"], env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout.splitlines()


def test_every_stage_is_run_somewhere_and_every_stage_that_is_run_exists(tmp_path):
    _, lines = run_with('echo "$1"', tmp_path, 0)
    run = {*lines[:-1]}
    workflows = [path.read_text(encoding="utf-8") for path in (ROOT / ".github" / "workflows").glob("*.yml")]
    listed = {
        name for text in workflows for found in re.findall(r"stage: \[(.*)\]", text) for name in found.split(", ")
    }
    assert {"tests", "clients", "full"} < run <= stages()
    assert listed == stages()


def test_a_run_begins_with_what_is_required_and_gives_each_other_stage_its_turn(tmp_path):
    seen = []
    for commits in range(13):
        status, lines = run_with('echo "$@"', tmp_path / str(commits), commits)
        assert status == 0
        assert lines[:4] == ["tests", "lint", "types", "package"]
        assert lines[-1].startswith("== passed in ")
        seen.append(lines[4:-1])
    # With time for all, each is played at every commit, and each comes first at one of them.
    assert {frozenset(each) for each in seen} == {frozenset(each[0] for each in seen)}
    assert all(len(each) == 13 for each in seen)


def test_the_full_tests_are_played_in_parts_that_are_all_of_them(tmp_path):
    _, lines = run_with('echo "$@"', tmp_path, 0)
    parts = [line.split()[1:] for line in lines if line.startswith("full ")]
    played = [folder for part in parts for folder in part if not folder.startswith("--ignore=")]
    (rest,) = (part for part in parts if part[0].startswith("--ignore="))
    assert len(parts) == 3
    assert rest == [f"--ignore={folder}" for folder in played]
    assert all((ROOT / folder).is_dir() for folder in played)


def test_a_run_ends_with_the_first_stage_that_fails(tmp_path):
    status, lines = run_with('echo "$1"; [ "$1" != types ]', tmp_path, 0)
    assert status != 0
    assert lines == ["tests", "lint", "types"]

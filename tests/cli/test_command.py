"""A command with settings and a job of its own: how arguments are read, and which exit statuses errors have."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest
from help_text import flag_lines

from kitchen_suite.cli.command import Command
from kitchen_suite.cli.options import OPTIONS


class UsageError(Exception):
    """An error that is the user's."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    source: str
    output: Path
    num_episodes: int = 3
    num_envs: tuple[int, ...] = (1, 8)
    video_fps: float = 25.0
    measure: str = "speed"
    seed: int | None = None
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    resume: bool = False


class Job:
    """Records its settings, and does as the test says."""

    failures = (OSError,)
    usage_errors = (UsageError,)
    settings: ClassVar[list[Settings]] = []

    def __init__(self, settings):
        if settings.num_episodes > 100:
            raise ValueError("too many\n episodes")
        self.settings.append(settings)

    def run(self):
        return True

    def progress(self):
        return "after 1 of 3 episodes"


def command(**changes):
    defaults = {"name": "kitchen-test", "description": "Tests.", "settings": Settings, "positional": "source"}
    return Command(**{**defaults, "job": f"{__name__}:Job", **changes})


REQUIRED = ("runs", "--output=folder")


@pytest.fixture(autouse=True)
def no_settings():
    Job.settings.clear()


def test_arguments_become_settings_of_their_types():
    arguments = [
        "--num_episodes=5",
        "--num_envs=2,4",
        "--video_fps=12.5",
        "--measure=soak",
        "--seed=0",
        '--task_kwargs={"threshold": 0.1}',
        "--resume",
    ]
    assert command().main([*REQUIRED, *arguments]) == 0
    assert Job.settings == [
        Settings(
            source="runs",
            output=Path("folder"),
            num_episodes=5,
            num_envs=(2, 4),
            video_fps=12.5,
            measure="soak",
            seed=0,
            task_kwargs={"threshold": 0.1},
            resume=True,
        )
    ]


def test_defaults_are_those_of_the_settings_in_every_run():
    tested = command()
    assert tested.main([*REQUIRED, "--num_episodes=5", '--task_kwargs={"threshold": 0.1}', "--resume"]) == 0
    assert tested.main(["--output=folder", "runs"]) == 0
    assert Job.settings[1] == Settings(source="runs", output=Path("folder"))


BAD = {
    "--output=folder": "source is missing: Folder of kitchen-record",
    "runs": "--output is missing: Folder to write to.",
    "runs more --output=folder": "unexpected argument 'more': all others are flags, see --help",
    "runs --output=": "is empty",
    "runs --output=folder --num_episodes=0": "must be at least 1",
    "runs --output=folder --num_episodes=-3": "must be at least 1",
    "runs --output=folder --num_episodes=1.5": "'1.5' is not an integer",
    "runs --output=folder --num_episodes=": "'' is not an integer",
    "runs --output=folder --num_episodes": "Missing value for flag --num_episodes",
    "runs --output=folder --num_episodes=101": "too many episodes",
    "runs --output=folder --num_envs=1,0": "must be at least 1",
    "runs --output=folder --num_envs=1,,2": "'' is not an integer",
    "runs --output=folder --video_fps=0": "must be at least 0.1",
    "runs --output=folder --video_fps=nan": "must be finite",
    "runs --output=folder --video_fps=fast": "'fast' is not a number",
    "runs --output=folder --measure=time": "must be one of speed, scaling, soak",
    "runs --output=folder --seed=-1": "must be at least 0",
    "runs --output=folder --task_kwargs=[1]": "must be a JSON object",
    "runs --output=folder --task_kwargs={": "not JSON",
    "runs --output=folder --resume=perhaps": "flag --resume=perhaps: must be true or false, or the flag alone",
    "runs --output=folder --episodes=3": "there is no flag --episodes (did you mean --num_episodes?)",
    "runs --output=folder --num_episodes=9999999": "must be at most 1000000",
    "runs --output=folder --environments=3": "there is no flag --environments (did you mean --num_envs?)",
    "runs --output=folder --colour=red": "there is no flag --colour; --help lists all",
    "runs --output=folder -- big": "unexpected argument 'big': all others are flags",
    "runs --output=folder --undefok=sed --sed=1": "there is no flag --undefok",
    "runs --output=folder --sed=1": "there is no flag --sed (did you mean --seed?); --help lists all",
}


@pytest.mark.parametrize("arguments", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(arguments, capsys):
    assert command().main(arguments.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"kitchen-test: [^\n]+\n", err)
    assert BAD[arguments] in err
    assert Job.settings == []


@pytest.mark.parametrize("error", [ImportError, OSError, TypeError, ValueError])
def test_an_error_of_the_preparation_gets_one_line_and_status_2(error, capsys, monkeypatch):
    def refuse(self, settings):
        raise error("no\nsuch   job")

    monkeypatch.setattr(Job, "__init__", refuse)
    assert command().main(REQUIRED) == 2
    assert capsys.readouterr() == ("", "kitchen-test: no such job\n")


def test_an_interrupt_of_the_preparation_gets_one_line(capsys, monkeypatch):
    def interrupt(self, settings):
        raise KeyboardInterrupt

    monkeypatch.setattr(Job, "__init__", interrupt)
    assert command().main(REQUIRED) == 130
    assert capsys.readouterr() == ("", "kitchen-test: interrupted\n")


def raise_in_run(monkeypatch, error):
    def run(self):
        raise error

    monkeypatch.setattr(Job, "run", run)


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted after 1 of 3 episodes"),
        (OSError("disk\nfull"), 1, "disk full"),
        (UsageError("lost"), 2, "lost"),
    ],
)
def test_an_error_of_the_job_gets_one_line_and_its_status(error, status, words, capsys, monkeypatch):
    raise_in_run(monkeypatch, error)
    assert command().main(REQUIRED) == status
    assert capsys.readouterr() == ("", f"kitchen-test: {words}\n")


# A broken pipe is an OSError, but no failure of the job; others are bugs.
@pytest.mark.parametrize("error", [BrokenPipeError(), ZeroDivisionError(), ValueError(), TypeError()])
def test_other_errors_of_the_job_are_raised(error, capsys, monkeypatch):
    raise_in_run(monkeypatch, error)
    with pytest.raises(type(error)):
        command().main(REQUIRED)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(("success", "status"), [(True, 0), (False, 1)])
def test_the_status_is_the_jobs_success(success, status, monkeypatch):
    monkeypatch.setattr(Job, "run", lambda self: success)
    assert command().main(REQUIRED) == status


def test_a_missing_extra_is_named_with_the_command_that_installs_it(capsys):
    needs = (("json", "no_such_package", "nor_this_one"), "train")
    assert command(needs=needs).main(REQUIRED) == 2
    assert capsys.readouterr().err == (
        "kitchen-test: kitchen-test needs no_such_package and nor_this_one: pip install 'kitchen-suite[train]'\n"
    )


@pytest.mark.parametrize("wanted", [False, True])
def test_a_gl_library_is_prepared_for_jobs_that_render(wanted, monkeypatch):
    prepared = []
    monkeypatch.setattr("kitchen_suite.rendering.gl.prepare", lambda rendering: prepared.append(rendering))
    assert command(renders=lambda settings: settings.resume).main([*REQUIRED, *(["--resume"] if wanted else [])]) == 0
    assert prepared == [wanted]


def test_help_shows_defaults():
    tested = command()
    lines = flag_lines(tested._help())
    assert lines["num_episodes"].endswith(" Default: 3.")
    assert lines["num_envs"].endswith(" Default: 1,8.")
    assert lines["video_fps"].endswith(" Default: 25.0.")
    assert lines["output"].endswith(" Required.")
    assert lines["seed"] == OPTIONS["seed"].help
    for name in ("task_kwargs", "resume"):
        assert lines[name] == OPTIONS[name].help


def test_a_very_long_argument_is_shortened_in_the_message(capsys):
    assert command().main([*REQUIRED, "--seed=" + "9" * 50_000]) == 2
    assert len(capsys.readouterr().err) < 1100


def test_a_very_long_flag_is_only_unknown(capsys):
    assert command().main([*REQUIRED, "--" + "num_envs" * 5_000]) == 2
    assert capsys.readouterr().err.startswith("kitchen-test: there is no flag --num_envs")

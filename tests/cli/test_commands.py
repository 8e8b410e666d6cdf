"""Properties of every command: its flags, its help, and its exit statuses."""

import dataclasses
import importlib.metadata
import os
import re
import shlex
import signal
import subprocess
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest
from sweeps import brief

import kitchen_suite
from kitchen_suite import checks
from kitchen_suite.cli import benchmark, convert, evaluate, export, play, process, record, replay, rollout, train, view
from kitchen_suite.cli.command import Command
from kitchen_suite.cli.options import OPTIONS

MODULES = (benchmark, convert, evaluate, export, play, record, replay, rollout, train, view)
COMMANDS = {command.COMMAND.name: command.COMMAND for command in MODULES}


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


SCRIPT = """
import os, signal, sys
from kitchen_suite.cli import command
from kitchen_suite.rollouts.settings import PlaySettings

class Job:
    failures, usage_errors = (OSError,), ()

    def __init__(self, settings):
        self.count = settings.num_episodes

    def run(self):
        {run}

    def progress(self):
        return f"after 2 of {{self.count}} episodes"

command.gl.prepare = lambda rendering: None
{setup}
command = command.Command(name="kitchen-test", description=None, settings=PlaySettings, job="__main__:Job")
sys.exit(command.console_main())
"""


def run_process(run, setup="", **streams):
    script = SCRIPT.format(run=run, setup=setup)
    return subprocess.Popen([sys.executable, "-c", script, "--num_episodes=9"], stderr=subprocess.PIPE, **streams)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_both_signals_interrupt_the_job(number):
    with run_process(
        f"os.kill(os.getpid(), {int(number)}); signal.pause()",
        stdout=subprocess.PIPE,
        # A shell's background jobs ignore SIGINT, and hand that down to what they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, b"")
    assert err == b"kitchen-test: interrupted after 2 of 9 episodes\n"


# Python notices a closed pipe when it flushes: during the job, or after it.
@pytest.mark.parametrize("run", ["print('line' * 100_000); return True", "print('line'); return True"])
def test_a_closed_pipe_gets_its_own_status_and_no_traceback(run):
    reader, writer = os.pipe()
    os.close(reader)
    with run_process(run, stdout=writer) as process:
        os.close(writer)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (141, b"")


# An extension module that is interrupted while it is imported raises an ImportError.
def test_an_interrupt_amid_imports_is_an_interrupt():
    with run_process(
        "return True",
        setup="def prepare(rendering):\n"
        "    try:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    except KeyboardInterrupt:\n"
        "        raise ImportError('initialization failed')\n"
        "command.gl.prepare = prepare",
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, b"kitchen-test: interrupted\n")


# Python prints what a destructor raises, and goes on.
def test_an_interrupt_in_a_destructor_is_not_lost():
    with run_process(
        "Unlucky(); [signal.pause() for _ in range(2)]",
        setup="class Unlucky:\n    def __del__(self):\n        os.kill(os.getpid(), signal.SIGTERM)",
    ) as process:
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, b"kitchen-test: interrupted after 2 of 9 episodes\n")


WORK = "print('line'); open('done', 'w'); return True"


def run_shell(tmp_path, streams, arguments="", run=WORK):
    """Runs the test's command in a shell with redirected streams; returns its status, stdout and stderr."""
    script = SCRIPT.format(run=run, setup="")
    line = f"exec {shlex.quote(sys.executable)} -c {shlex.quote(script)} {arguments} {streams}"
    process = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    return process.returncode, process.stdout, process.stderr


@pytest.mark.parametrize("streams", [">&-", "2>&-", "<&-", "<&- >&- 2>&-", "2>/dev/full"])
@pytest.mark.parametrize("arguments", brief(["", "--help"], kept=[""]))
def test_a_closed_stream_ends_in_no_traceback(tmp_path, streams, arguments):
    status, out, err = run_shell(tmp_path, streams, arguments)
    assert (status, err) == (0, "")
    assert bool(out) == (">&-" not in streams.replace("2>&-", ""))
    # The file has not taken the number of a closed stream, to which libraries write.
    assert tmp_path.joinpath("done").exists() == (not arguments)


@pytest.mark.parametrize("arguments", ["", "--help", "--version"])
def test_a_full_stdout_gets_one_line(tmp_path, arguments):
    status, _, err = run_shell(tmp_path, ">/dev/full", arguments)
    assert status == 1
    # Python notices when it flushes: during the job, or after it.
    assert re.fullmatch(r"kitchen-test: (stdout cannot be written to: )?\[Errno 28\] No space left on device\n", err)


@pytest.mark.parametrize("streams", ["2>&-", "2>/dev/full"])
def test_a_bad_argument_keeps_its_status_where_stderr_is_lost(tmp_path, streams):
    assert run_shell(tmp_path, streams, "--num_episodes=x") == (2, "", "")


def test_a_very_long_argument_is_shortened_in_the_message(capsys):
    assert command().main([*REQUIRED, "--seed=" + "9" * 50_000]) == 2
    assert len(capsys.readouterr().err) < 1100


def test_a_very_long_flag_is_only_unknown(capsys):
    assert command().main([*REQUIRED, "--" + "num_envs" * 5_000]) == 2
    assert capsys.readouterr().err.startswith("kitchen-test: there is no flag --num_envs")


def test_bounds_are_those_of_the_environments():
    assert OPTIONS["num_envs"].maximum == OPTIONS["eval_episodes"].maximum == checks.MAX_ENVS
    assert OPTIONS["num_threads"].maximum == checks.MAX_THREADS


def test_all_commands_are_tested_here():
    scripts = importlib.metadata.entry_points(group="console_scripts")
    installed = {script.name: script.load() for script in scripts if script.value.startswith("kitchen_suite.")}
    assert installed == {name: tested.console_main for name, tested in COMMANDS.items()}


def flags_of(tested):
    """Names of a command's flags."""
    names = {field.name for field in dataclasses.fields(tested.settings)} - {tested.positional}
    return names | {"help", "version"}


def flag_lines(text):
    """Help of each flag by its name, in the order of the text, with single spaces."""
    _, flags = text.split("\nFlags:\n")
    rows = re.findall(r"^  --(\w+) +(.*(?:\n {24}.*)*)", flags, flags=re.MULTILINE)
    assert f"\n{flags}".count("\n  --") == len(rows)
    return {name: " ".join(text.split()) for name, text in rows}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("flag", ["--help", "-h", "-?", "--helpshort", "--helpfull"])
def test_help_lists_every_flag_in_the_order_and_words_of_the_options(name, flag, capsys):
    tested = COMMANDS[name]
    assert tested.main([flag]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith(f"{tested.description}\nFlags:\n")
    assert f"\n  {name}" in tested.description
    assert len(out.splitlines()) <= 60
    lines = flag_lines(out)
    assert list(lines) == [option for option in OPTIONS if option in flags_of(tested)]
    for option, text in lines.items():
        # The same in every command, but for the default.
        unset = {field.name: field.metadata.get("unset") for field in dataclasses.fields(tested.settings)}.get(option)
        unset = re.escape(f" Default: {unset or OPTIONS[option].unset}.")
        endings = ("", r" Default: [^ ]+\.", unset, r" Required\.")
        assert any(re.fullmatch(re.escape(OPTIONS[option].help) + ending, text) for ending in endings), text


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


@pytest.mark.parametrize("name", COMMANDS)
def test_version_is_that_of_the_package(name, capsys):
    assert COMMANDS[name].main(["--version"]) == 0
    assert capsys.readouterr() == (f"{name} {kitchen_suite.__version__}\n", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_an_unknown_flag_gets_one_line_with_the_nearest_and_status_2(name, capsys):
    flag = next(option for option in OPTIONS if option in flags_of(COMMANDS[name]) and len(option) > 5)
    assert COMMANDS[name].main([f"--{flag[:-1]}=1"]) == 2
    assert capsys.readouterr() == (
        "",
        f"{name}: there is no flag --{flag[:-1]} (did you mean --{flag}?); --help lists all\n",
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_an_argument_too_many_gets_one_line_and_status_2(name, capsys):
    tested = COMMANDS[name]
    assert tested.main(["one", "two"]) == 2
    extra = "two" if tested.positional else "one"
    assert capsys.readouterr() == ("", f"{name}: unexpected argument '{extra}': all others are flags, see --help\n")


REQUIRED_SETTINGS = {
    "kitchen-record": "--output",
    "kitchen-replay": "source",
    "kitchen-train": "--output",
    "kitchen-export": "--output",
}


@pytest.mark.parametrize("name", REQUIRED_SETTINGS)
def test_a_missing_argument_gets_one_line_and_status_2(name, capsys):
    assert COMMANDS[name].main([]) == 2
    argument = REQUIRED_SETTINGS[name]
    option = OPTIONS[argument.removeprefix("--")]
    assert capsys.readouterr() == ("", f"{name}: {argument} is missing: {option.help}\n")


def test_options_are_the_settings_of_all_commands():
    used = {field.name for tested in COMMANDS.values() for field in dataclasses.fields(tested.settings)}
    assert used | {"help", "version"} == OPTIONS.keys()


@pytest.mark.parametrize("name", OPTIONS)
def test_the_help_of_an_option_is_one_or_two_sentences(name):
    assert re.fullmatch(r"[A-Za-z][^\n]*[.]", OPTIONS[name].help)
    assert len(OPTIONS[name].help) <= 220


@pytest.mark.parametrize("name", COMMANDS)
def test_a_reader_who_leaves_before_the_help_is_no_usage_error(name, monkeypatch):
    def leave(*args):
        raise BrokenPipeError

    monkeypatch.setattr("builtins.print", leave)
    with pytest.raises(BrokenPipeError):
        COMMANDS[name].main(["--help"])


def test_a_warning_of_python_takes_one_line(monkeypatch):
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    process.shorten_warnings()
    assert (
        warnings.formatwarning(UserWarning("no light meshes"), UserWarning, "a.py", 3)
        == "UserWarning: no light meshes\n"
    )

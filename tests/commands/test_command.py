"""A command with a job of its own: exit statuses, the line on stderr, and the process that runs it."""

# ruff: noqa: RUF009, each call makes a field of its own

import dataclasses
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import pytest

from kitchen_suite import checks
from kitchen_suite.commands.command import Command
from kitchen_suite.settings import FAILURE, USAGE, flag, num_episodes_flag, output_flag, seed_flag


class UsageError(Exception):
    """An error that is the user's."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    source: str = flag("Recording to replay.")
    output: Path = output_flag()
    num_episodes: int = num_episodes_flag(3)
    seed: int = seed_flag(0)


class Job:
    """Does as the test says."""

    errors: ClassVar = {UsageError: USAGE, OSError: FAILURE}

    def __init__(self, settings):
        self.settings = settings

    def run(self):
        return True

    def progress(self):
        return f"after 1 of {self.settings.num_episodes} episodes"


def command(**changes):
    defaults = {"name": "kitchen-test", "description": "Tests.\n", "settings": Settings, "positional": "source"}
    return Command(**{**defaults, "job": f"{__name__}:Job", **changes})


REQUIRED = ("runs", "--output=folder")

BAD = {
    "": "source is missing: Recording to replay",
    "runs": "--output is missing: Folder to write to.",
    "runs more --output=folder": "unexpected argument 'more': all others are flags, see --help",
    "runs --output=folder -- more": "unexpected argument 'more'",
    "runs --output=folder --sed=1": "there is no flag --sed (did you mean --seed?); --help lists all",
    "runs --output=folder --colour=red": "there is no flag --colour; --help lists all",
    "runs --output=folder --seed=-1": "flag --seed=-1: must be at least 0",
    f"runs --output=folder --seed={'9' * 50_000}": "(shortened)",
    f"runs --output=folder --{'seed' * 10_000}=1": "there is no flag --seedseed",
}


@pytest.mark.parametrize("arguments", BAD, ids=lambda text: text[:40])
def test_a_bad_argument_gets_one_line_and_status_2(arguments, capsys):
    assert command().main(arguments.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"kitchen-test: [^\n]+\n", err)
    assert BAD[arguments] in err
    assert len(err) < 1100


@pytest.mark.parametrize("error", [ImportError, OSError, TypeError, ValueError])
def test_an_error_of_the_preparation_gets_one_line_and_status_2(error, capsys, monkeypatch):
    def refuse(self, settings):
        raise error("no\nsuch   job")

    monkeypatch.setattr(Job, "__init__", refuse)
    assert command().main(REQUIRED) == 2
    assert capsys.readouterr() == ("", "kitchen-test: no such job\n")


def test_an_interrupt_of_the_preparation_gets_one_line_and_status_130(capsys, monkeypatch):
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
@pytest.mark.parametrize("error", [BrokenPipeError(), ZeroDivisionError()])
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
    install = checks.install_command("train")
    assert capsys.readouterr().err == f"kitchen-test: kitchen-test needs no_such_package and nor_this_one: {install}\n"


@pytest.mark.parametrize("wanted", [False, True])
def test_a_gl_library_is_prepared_for_jobs_that_render(wanted, monkeypatch):
    prepared = []
    monkeypatch.setattr("kitchen_suite.rendering.gl.prepare", lambda rendering: prepared.append(rendering))
    assert command(renders=lambda settings: settings.seed == 1).main([*REQUIRED, f"--seed={int(wanted)}"]) == 0
    assert prepared == [wanted]


SCRIPT = """
import os, signal, sys
from kitchen_suite.commands import command
from kitchen_suite.settings import FAILURE, PlaySettings

class Job:
    errors = {{OSError: FAILURE}}

    def __init__(self, settings):
        self.count = settings.num_episodes

    def run(self):
        {run}

    def progress(self):
        return f"after 2 of {{self.count}} episodes"

command.gl.prepare = lambda rendering: None
{setup}
sys.exit(command.Command(name="kitchen-test", description="", settings=PlaySettings, job="__main__:Job")())
"""


def run_process(run="return True", setup="", arguments="--num_episodes=9", streams="", folder=None):
    """Runs a command in a shell that may redirect its streams; returns its status, stdout and stderr."""
    script = SCRIPT.format(run=run, setup=setup)
    done = subprocess.run(
        f"exec {shlex.quote(sys.executable)} -c {shlex.quote(script)} {arguments} {streams}",
        shell=True,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        # A shell's background jobs ignore SIGINT, and hand that down to what they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    return done.returncode, done.stdout, done.stderr


KILL = f"os.kill(os.getpid(), {int(signal.SIGTERM)})"

INTERRUPTS = {
    "the job": (f"{KILL}; signal.pause()", "", " after 2 of 9 episodes"),
    # Python prints what a destructor raises, and goes on.
    "a destructor": (
        "Unlucky(); [signal.pause() for _ in range(2)]",
        f"class Unlucky:\n    def __del__(self):\n        {KILL}",
        " after 2 of 9 episodes",
    ),
    # An extension module that is interrupted while it is imported raises an ImportError.
    "an import": (
        "return True",
        "def prepare(rendering):\n"
        f"    try:\n        {KILL}\n"
        "    except KeyboardInterrupt:\n        raise ImportError('initialization failed')\n"
        "command.gl.prepare = prepare",
        "",
    ),
}


@pytest.mark.parametrize("place", INTERRUPTS)
def test_a_signal_interrupts(place):
    run, setup, progress = INTERRUPTS[place]
    assert run_process(run, setup) == (130, "", f"kitchen-test: interrupted{progress}\n")


# Python notices a closed pipe when it flushes: during the job, or after it.
@pytest.mark.parametrize("line", ["'line' * 100_000", "'line'"])
def test_a_closed_pipe_gets_its_own_status_and_no_traceback(line):
    script = SCRIPT.format(run=f"print({line}); return True", setup="")
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([sys.executable, "-c", script], stdout=writer, stderr=subprocess.PIPE, timeout=60)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


WORK = "print('line'); open('done', 'w'); return True"


@pytest.mark.parametrize("streams", [">&-", "<&- >&- 2>&-", "2>/dev/full"])
def test_a_closed_stream_ends_in_no_traceback(tmp_path, streams):
    status, out, err = run_process(WORK, streams=streams, folder=tmp_path)
    assert (status, err) == (0, "")
    assert bool(out) == (">&-" not in streams)
    # The file has not taken the number of a closed stream, to which libraries write.
    assert tmp_path.joinpath("done").read_text() == ""


@pytest.mark.parametrize("arguments", ["", "--help"])
def test_a_full_stdout_gets_one_line(tmp_path, arguments):
    status, _, err = run_process(WORK, arguments=arguments, streams=">/dev/full", folder=tmp_path)
    assert status == 1
    # Python notices when it flushes: during the job, or after it.
    assert re.fullmatch(r"kitchen-test: (stdout cannot be written to: )?\[Errno 28\] No space left on device\n", err)


def test_a_bad_argument_keeps_its_status_where_stderr_is_lost():
    assert run_process(arguments="--num_episodes=x", streams="2>/dev/full") == (2, "", "")


def test_a_warning_of_python_takes_one_line():
    run = "import warnings; warnings.warn('no light meshes'); return True"
    assert run_process(run) == (0, "", "UserWarning: no light meshes\n")

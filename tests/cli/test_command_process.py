"""A command as a process of its own: interrupts, closed streams, and full disks."""

import os
import re
import shlex
import signal
import subprocess
import sys
import warnings

import pytest
from helpers.sweeps import brief

from kitchen_suite.cli import process

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


def test_a_warning_of_python_takes_one_line(monkeypatch):
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    process.shorten_warnings()
    assert (
        warnings.formatwarning(UserWarning("no light meshes"), UserWarning, "a.py", 3)
        == "UserWarning: no light meshes\n"
    )

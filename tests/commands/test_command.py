"""A command: its flags and their help, exit statuses, the line on stderr, and the process that runs it."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from absl.flags import DEFINE_boolean, DEFINE_enum, DEFINE_integer, DEFINE_list
from help_text import flag_lines
from helpers.processes import heed_interrupts

from kitchen_suite import checks
from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command


def define(values):
    flags.output(values, required=True)
    flags.file(values, "json", "Results.")
    flags.file(values, "video", "Video.", suffix=".mp4")
    flags.number(values, "rate", 25.0, "Things per second.", minimum=0.1)
    flags.json_object(values, "arguments", "Arguments.")
    DEFINE_integer("count", 3, "Number of things.", 1, 100, flag_values=values)
    DEFINE_enum("physics", "exact", ("exact", "fast"), "Kind of physics.", values)
    DEFINE_list("folders", [], "Folders.", values)
    DEFINE_boolean("resume", False, "Continue.", values)


def make(run=lambda given: None, **changes):
    return Command(**{"name": "kitchen-test", "description": "Tests.\n", "define": define, "run": run, **changes})


def given(*arguments, **changes):
    """Returns the flags of a command with some arguments."""
    return make(**changes).parse(["--output=folder", *arguments])[0]


def test_arguments_become_values_of_the_flags():
    values = given(
        "--json=a.json",
        "--resume",
        "--folders=a,b",
        "--physics=fast",
        "--rate=12.5",
        "--count=5",
        '--arguments={"threshold": 0.1}',
        "--video=a.mp4",
    )
    assert (values.output, values.json, values.video) == (Path("folder"), Path("a.json"), Path("a.mp4"))
    assert (values.count, values.rate, values.physics, values.resume) == (5, 12.5, "fast", True)
    assert (values.folders, values.arguments) == (["a", "b"], {"threshold": 0.1})


def test_values_are_the_defaults_after_every_use():
    given("--count=5", "--resume", '--arguments={"threshold": 0.1}', "--folders=a")
    values = given("--resume", "--noresume")
    assert (values.count, values.resume, values.arguments, values.folders, values.json) == (3, False, {}, [], None)


def test_flags_may_stand_before_and_behind_the_argument_without_a_flag():
    command = make(positional="recording")
    for arguments in (["runs", "--output=a", "--count=2"], ["--output=a", "--count=2", "runs"]):
        values, source = command.parse(arguments)
        assert (values.count, source) == (2, "runs")


BAD_VALUES = {
    "--count=0": "flag --count=0: ",
    "--count=101": "[1, 100]",
    "--count=1.5": "1.5",
    "--count": "Missing value for flag --count",
    "--rate=fast": "fast",
    "--rate=nan": "must be finite",
    "--rate=0": "0.1",
    "--physics=fats": "<exact|fast>",
    "--arguments={": "cannot be read as JSON",
    f"--arguments={'[' * 10_000}": "nested too deeply",
    "--arguments=a.json": 'write "$(cat a.json)"',
    "--arguments=[1]": "must be a JSON object",
    "--resume=perhaps": "Non-boolean argument",
    "--json=": "is empty",
    "--json=.": "is not a file",
    "--video=film.avi": "ends with .mp4",
    "--video=nowhere/film.mp4": "there is no folder 'nowhere'",
    "--output=file": "is not a folder",
    "--counts=1": "there is no flag --counts (did you mean --count?)",
    "--Count=1": "did you mean --count?",
    "--colour=red": "there is no flag --colour",
    "more": "unexpected argument 'more'",
    "--flagfile=nothing": "nothing",
    f"--count={'9' * 50_000}": "(shortened)",
}


@pytest.mark.parametrize("argument", BAD_VALUES, ids=lambda text: text[:40])
def test_a_bad_argument_gets_one_line_and_status_2(argument, folder, capsys):
    Path("file").write_text("--output=a")
    assert make().main(["--output=folder", argument]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"kitchen-test: [^\n]+\n", err)
    assert BAD_VALUES[argument] in err
    assert len(err) < 1100


def test_what_is_missing_gets_one_line_and_status_2(capsys):
    assert make().main([]) == 2
    assert "--output" in capsys.readouterr().err
    assert make(positional="recording").main(["--output=a"]) == 2
    assert "recording is missing" in capsys.readouterr().err


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_has_the_description_and_every_flag_with_its_default(flag, capsys):
    # Also where a required flag is missing, and whatever else is given.
    assert make().main([flag, "--count=0"]) == 0
    out, err = capsys.readouterr()
    assert (out.startswith("Tests.\n\nFlags:\n"), err) == (True, "")
    lines = flag_lines(out)
    assert {*lines} == {*make().flags()} - {"h"}
    assert "(default: '3')" in lines["count"]
    assert "[1, 100]" in lines["count"]
    assert "<exact|fast>" in lines["physics"]
    assert "Folder to write to." in lines["output"]


def raising(error):
    def run(given):
        raise error

    return make(run)


class Failed(checks.WorkFailedError):
    """Work that failed."""


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (OSError("disk\nfull"), 1, "disk full"),
        (Failed("lost"), 1, "lost"),
        (FileNotFoundError("no such   recording"), 2, "no such recording"),
        (ImportError("no ray"), 2, "no ray"),
        (TypeError("no number"), 2, "no number"),
        (ValueError("no such task"), 2, "no such task"),
    ],
)
def test_a_problem_gets_one_line_and_its_status(error, status, words, capsys):
    assert raising(error).main(["--output=a"]) == status
    assert capsys.readouterr() == ("", f"kitchen-test: {words}\n")


# A broken pipe is an OSError, but no failure of the work; others are bugs, whose traceback is wanted.
@pytest.mark.parametrize("error", [BrokenPipeError(), ZeroDivisionError()])
def test_other_errors_are_raised(error, capsys):
    with pytest.raises(type(error)):
        raising(error).main(["--output=a"])
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("status", [None, 0, 1, 3])
def test_the_work_may_return_a_status(status):
    assert make(lambda given: status).main(["--output=a"]) == (status or 0)


def test_a_diverged_physics_is_a_failure(capsys):
    from dm_control.rl.control import PhysicsError

    assert raising(PhysicsError("it diverged")).main(["--output=a"]) == 1
    assert capsys.readouterr().err == "kitchen-test: it diverged\n"


SCRIPT = """
import os, signal, sys
from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command

def run(given):
    {run}

sys.exit(Command(name="kitchen-test", description="", define=lambda values: flags.num_episodes(values, 3), run=run)())
"""


def run_process(run="return", arguments="--num_episodes=9", streams="", folder=None):
    """Runs a command in a shell that may redirect its streams; returns its status, stdout and stderr."""
    script = SCRIPT.format(run=run)
    done = subprocess.run(
        f"exec {shlex.quote(sys.executable)} -c {shlex.quote(script)} {arguments} {streams}",
        shell=True,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=heed_interrupts,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts(number):
    run = f"os.kill(os.getpid(), {int(number)}); signal.pause()"
    assert run_process(run) == (130, "", "kitchen-test: interrupted\n")


# Python notices a closed pipe when it flushes: during the work, or after it.
@pytest.mark.full
@pytest.mark.parametrize("line", ["'line' * 100_000", "'line'"])
def test_a_closed_pipe_gets_its_own_status_and_no_traceback(line):
    script = SCRIPT.format(run=f"print({line})")
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([sys.executable, "-c", script], stdout=writer, stderr=subprocess.PIPE, timeout=60)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.full
@pytest.mark.parametrize("arguments", ["", "--help"])
def test_a_full_stdout_gets_one_line(tmp_path, arguments):
    status, _, err = run_process("print('line')", arguments=arguments, streams=">/dev/full", folder=tmp_path)
    assert status == 1
    # Python notices when it flushes: during the work, or after it.
    assert re.fullmatch(r"kitchen-test: (stdout cannot be written to: )?\[Errno 28\] No space left on device\n", err)


@pytest.mark.full
def test_a_bad_argument_keeps_its_status_where_stderr_is_lost():
    assert run_process(arguments="--num_episodes=x", streams="2>/dev/full") == (2, "", "")


def test_a_warning_of_python_takes_one_line():
    assert run_process("import warnings; warnings.warn('no light meshes')") == (
        0,
        "",
        "UserWarning: no light meshes\n",
    )

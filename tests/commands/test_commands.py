"""The commands: their help, `kitchen-suite`, a domain of a user's own, and odd command lines."""

import contextlib
import importlib.metadata
import io
import json
import os
import re
import resource
import subprocess
import sys
import sysconfig
from pathlib import Path

import gymnasium
import pytest
from absl import flags as absl_flags
from help_text import flag_lines
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import kitchen_suite
from kitchen_suite import commands, suite
from kitchen_suite.commands import NAMES, export, find, flags, record, rollout

KITCHEN_SUITE = [sys.executable, "-m", "kitchen_suite"]


def test_every_console_script_is_in_the_table():
    scripts = importlib.metadata.entry_points(group="console_scripts")
    installed = {script.name: script.load() for script in scripts if script.value.startswith("kitchen_suite")}
    assert installed == {"kitchen-suite": commands.console, **{f"kitchen-{name}": find(name) for name in NAMES}}


@pytest.mark.full
@pytest.mark.parametrize("name", ["kitchen-suite", "kitchen-record"])
def test_a_console_script_runs_its_command(name):
    script = Path(sysconfig.get_path("scripts")) / name
    done = subprocess.run([script, "--version"], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{name} {kitchen_suite.__version__}\n", "")


@pytest.mark.parametrize("name", NAMES)
def test_help_lists_every_flag(name, capsys):
    command = find(name)
    assert command.main(["--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith(f"{command.description.strip()}\n\nFlags:\n")
    assert f"\n  kitchen-{name}" in out
    assert {*flag_lines(out)} == {*command.flags()} - {"h"}


def test_bounds_are_those_of_the_environments():
    values = record.COMMAND.flags()
    assert values["num_envs"].parser.upper_bound == 65_536
    assert values["num_threads"].parser.upper_bound == 1_024


def test_a_reader_who_leaves_before_the_help_is_no_usage_error(monkeypatch):
    def leave(*args):
        raise BrokenPipeError

    monkeypatch.setattr("builtins.print", leave)
    with pytest.raises(BrokenPipeError):
        record.main(["--help"])


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_kitchen_suite_lists_the_commands_with_a_line_each(arguments, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["kitchen-suite"])
    assert commands.main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert {*re.findall(r"^  ([a-z]+) +[A-Z][^\n]+\.$", out, flags=re.MULTILINE)} == {*NAMES}
    assert max(map(len, out.splitlines())) <= 120


@pytest.mark.parametrize("arguments", [["record", "--version"], ["--version"]])
def test_kitchen_suite_and_its_commands_have_the_version_of_the_package(arguments, capsys):
    assert commands.main(arguments) == 0
    name = "kitchen-record" if "record" in arguments else "kitchen-suite"
    assert capsys.readouterr() == (f"{name} {kitchen_suite.__version__}\n", "")


def test_kitchen_suite_runs_a_command_with_its_arguments():
    done = subprocess.run([*KITCHEN_SUITE, "record", "--sed=1"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(r"kitchen-record: there is no flag --sed [^\n]+\n", done.stderr)


def test_an_unknown_command_gets_one_line_with_the_nearest_and_status_2(capsys):
    assert commands.main(["rolout"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"kitchen-suite: command 'rolout' does not exist \(did you mean 'rollout'\?\)[^\n]+\n", err)


OWN = """
import dataclasses

from kitchen_suite import suite

TABLE = dataclasses.replace(suite.DOMAINS["microwave_table"], name="own_table", env_id="Tests/OwnTable-v1")
TAKEN = dataclasses.replace(TABLE, name="kitchen")
"""
TINY_OWN = ("--domain_name=own_domain:TABLE", "--num_episodes=2", "--max_episode_steps=3")


@pytest.fixture
def own_domain(tmp_path, monkeypatch):
    """A module with a domain in the working directory; the suite is without it after the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    tmp_path.joinpath("own_domain.py").write_text(OWN)
    yield tmp_path
    sys.modules.pop("own_domain", None)
    suite._domains.pop("own_table", None)
    for env_id in [name for name in gymnasium.registry if name.startswith("Tests/OwnTable")]:
        del gymnasium.registry[env_id]


RUNS = {
    "rollout": ("rollout", [*TINY_OWN]),
    "evaluate": ("evaluate", [*TINY_OWN, "--num_envs=2"]),
    "export": ("export", ["--domain_name=own_domain:TABLE", "--output=scene"]),
}


@pytest.mark.full
@pytest.mark.parametrize("name", RUNS)
@pytest.mark.usefixtures("own_domain")
def test_a_command_loads_a_domain_of_the_users_own(name, capsys):
    command, arguments = RUNS[name]
    assert find(command).main(arguments) == 0
    assert capsys.readouterr().err == ""
    assert "own_table" in suite.DOMAINS


@pytest.mark.full
def test_a_recording_of_a_users_own_domain_is_replayed_and_completed_by_other_processes(own_domain):
    name = TINY_OWN[0].removeprefix("--domain_name=")
    for status, arguments in (
        (0, ["record", "--output=runs", *TINY_OWN]),
        # A file alone names no code.
        (1, ["replay", "runs"]),
        (0, ["replay", "runs", f"--custom={name}"]),
        (0, ["record", "--output=runs", *TINY_OWN, "--num_episodes=3"]),
    ):
        done = subprocess.run([*KITCHEN_SUITE, *arguments], cwd=own_domain, capture_output=True, text=True, timeout=120)
        assert done.returncode == status, done.stderr
        assert ("custom" in done.stderr) == bool(status)
    assert json.loads(own_domain.joinpath("runs", "recording.json").read_text())["domain_name"] == TINY_OWN[0][14:]


@pytest.mark.full
@pytest.mark.usefixtures("own_domain")
def test_load_takes_a_domain_of_the_users_own_and_registers_it_once():
    assert suite.load("own_domain:TABLE", "open", {"visuals": False}).control_timestep() > 0
    assert suite.find_domain("own_domain:TABLE") is suite.DOMAINS["own_table"]


OWN_REFUSED = {
    "no_such_module:TABLE": "No module named 'no_such_module'",
    "own_domain:TABEL": "AttributeError",
    "own_domain:OWN:": "ValueError",
    "own_domain:suite": "is no kitchen_suite.suite.Domain",
    "own_domain:TAKEN": "a domain 'kitchen' exists already",
}


@pytest.mark.parametrize("name", OWN_REFUSED)
@pytest.mark.usefixtures("own_domain")
def test_a_domain_that_cannot_be_loaded_gets_one_line_and_status_2(name, capsys):
    for command, arguments in ((rollout, []), (record, ["--output=runs"]), (export, ["--output=scene"])):
        assert command.main([f"--domain_name={name}", *arguments]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert re.fullmatch(rf"{command.COMMAND.name}: [^\n]+\n", err)
        assert OWN_REFUSED[name] in err


# Odd command lines end in the right result, or in one line and exit status 1 or 2; never in a traceback.

# First in the command line, so that an odd value takes their place: one episode of one control step.
TINY = {
    "record": ("--output=new", "--num_episodes=1", "--max_episode_steps=1"),
    "rollout": ("--num_episodes=1", "--max_episode_steps=1"),
    "play": ("--num_episodes=1", "--max_episode_steps=1", "--novideo"),
    "replay": ("recording",),
    "evaluate": ("--num_episodes=1", "--max_episode_steps=1"),
    "train": ("--output=new",),
    "export": ("--output=new",),
    "convert": ("file", "--output=new"),
}
# Last in the command line of commands whose work takes long: refused, after all flags have been parsed.
REFUSED = {
    "train": "--task_name=nothing",
    "export": "--task_name=nothing",
    "view": "--domain_name=nothing",
}
# Work that takes long, or needs a GL library.
LEFT_OUT = {"list", "measure", "novideo", "video", "workers"}

LARGE = "9" * 5_000
NUMBERS = ["0", "2", "-1", "1_0", "٣", "9" * 20, LARGE, "nan", "inf", "-inf", "1e155", "1e400", "1.5", "0x10", "[1]"]
TEXTS = [
    "",
    " ",
    "\0",
    "--",
    "=",
    "a\nb\x1b[31m\u202e",
    "\udcff",
    "x" * 50_000,
    "../..",
    "/dev/null",
    "None",
    "{}",
    "%s",
    "1,,2",
]
PATHS = ["nowhere/at/all", "file", "file/inside", "/dev/full", "/dev/zero", "fifo", "x" * 300, "recording", "empty"]
OBJECTS = ["[" * 100_000, "{", "[1]", '{"a": ' * 3_000, f'{{"threshold": {LARGE}}}', '{"disable_env_checker": true}']
OBJECTS += [json.dumps({name: value}) for name in ("threshold", "goals") for value in (1e999, None, [[1]], "x")]
OBJECTS += [f'{{"{name}": {"[" * depth}{"]" * depth}}}' for name in ("variations", "goals") for depth in (60, 100, 900)]
OBJECTS += ['{"control_mode": "ee_delta_pose", "linear_speed": 1e200}', '{"seed": 0}', '{"robot_noise_ratio": 1e308}']
OBJECTS += ['{"obs_type": "pixels", "image_size": [20000, 20000]}', '{"width": 1000000000, "height": 1}']
OBJECTS += ['{"num_envs": -1}', '{"hidden": [1e400]}', '{"": {"": {}}}']
POLICIES = ["expert(", f"expert(speed={'-' * 50_000}1)", "expert(sped=1)", "trained(file='/dev/zero')", "os:abort_"]
POLICIES += ["trained(file='fifo')", "expert(speed=__import__('os'))", ":", "zero(x=1)", "random()(", "a:b:c"]
EPISODES = ["0-99999999999", "5-0", "0,0,0", "-1", ",", "0-" + LARGE, "all,all", "٣"]
DOMAINS = ["os:path", "a:b", ":", "kitchn"]
VARIATIONS = ["start,start", ",", "{}", '{"kettle/mass": {"uniform": [0, 1e999]}}', '{"kettle/mass": null}', *OBJECTS]
BY_NAME = {"policy": POLICIES, "episodes": EPISODES, "domain_name": DOMAINS, "variations": VARIATIONS}
BY_PARSER = {
    flags.PathParser: PATHS,
    flags.JsonParser: OBJECTS,
    absl_flags.IntegerParser: NUMBERS,
    flags.FloatParser: NUMBERS,
    absl_flags.BooleanParser: ["", "0", "maybe"],
}


@st.composite
def command_lines(draw):
    """Name of a command and its arguments: one or two odd values, a flag twice or of another name, a stray word."""
    name = draw(st.sampled_from(sorted(NAMES)))
    values = find(name).flags()
    known = sorted({*values} - LEFT_OUT - {"h", "help", "version"})
    arguments = [*TINY.get(name, ())]
    for flag in draw(st.lists(st.sampled_from(known), min_size=1, max_size=2)) if known else []:
        odd = BY_NAME.get(flag) or BY_PARSER.get(type(values[flag].parser), TEXTS)
        value = draw(st.one_of(*[st.sampled_from(odd)] * 4, st.sampled_from(TEXTS), st.text(max_size=20)))
        form = draw(st.sampled_from(["--{}={}"] * 6 + ["--{}s={}", "--no{}", "{1}"]))
        arguments += [form.format(flag, value)] * draw(st.sampled_from([1, 1, 1, 2]))
    return name, [*arguments, *([REFUSED[name]] if name in REFUSED else [])]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a recording, an empty folder, a file and a pipe, in which the commands run."""
    path = tmp_path_factory.mktemp("odd")
    path.joinpath("file").write_text("no policy")
    path.joinpath("empty").mkdir()
    os.mkfifo(path / "fifo")
    with contextlib.chdir(path), contextlib.redirect_stdout(io.StringIO()):
        assert record.main(["--output=recording", "--num_episodes=2", "--max_episode_steps=1"]) == 0
    return path


def peak_memory():
    """In the unit of ru_maxrss [KiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def check(folder, line):
    name, arguments = line
    before = peak_memory()
    folder.joinpath("new").mkdir(exist_ok=True)
    for path in folder.joinpath("new").iterdir():
        path.unlink()
    # What cannot be encoded is written escaped, as in a process.
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", "backslashreplace") for _ in range(2))
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = find(name).main(arguments)
    err.seek(0)
    text = err.read()
    if status:
        assert status in (1, 2)
        assert re.fullmatch(rf"kitchen-{name}: [^\n]+\n", text)
        assert text[:-1].isprintable()
        assert len(text) < 1_500
    else:
        assert text == ""
    assert peak_memory() - before < 2**20  # 1 GiB


ODD = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
}


@pytest.mark.full
@settings(max_examples=40, **ODD)
@given(line=command_lines())
def test_odd_arguments_end_in_one_line(folder, line):
    check(folder, line)


@pytest.mark.nightly
@settings(max_examples=1_000, **ODD)
@given(line=command_lines())
def test_a_thousand_odd_arguments_end_in_one_line(folder, line):
    check(folder, line)

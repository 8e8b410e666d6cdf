"""Odd command lines end in the right result, or in one line and exit status 1 or 2; never in a traceback."""

import contextlib
import dataclasses
import io
import json
import os
import re
import resource
import typing
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kitchen_suite.cli import benchmark, convert, evaluate, export, play, record, replay, rollout, train, view
from kitchen_suite.cli.options import OPTIONS, RENAMED

MODULES = (benchmark, convert, evaluate, export, play, record, replay, rollout, train, view)
COMMANDS = {command.COMMAND.name: command.COMMAND for command in MODULES}

# First in the command line, so that an odd value takes their place: one episode of one control step.
TINY = {
    "kitchen-record": ("--output=new", "--num_episodes=1", "--max_episode_steps=1"),
    "kitchen-rollout": ("--num_episodes=1", "--max_episode_steps=1"),
    "kitchen-play": ("--num_episodes=1", "--max_episode_steps=1", "--novideo"),
    "kitchen-replay": ("recording",),
    "kitchen-evaluate": ("--num_episodes=1", "--max_episode_steps=1"),
    "kitchen-train": ("--output=new",),
    "kitchen-export": ("--output=new",),
    "kitchen-convert": ("file", "--output=new"),
    "kitchen-benchmark": (),
    "kitchen-view": (),
}

# Last in the command line of commands whose work takes long: refused, after all flags have been parsed.
REFUSED = {
    "kitchen-train": "--task_name=nothing",
    "kitchen-benchmark": "--domain_name=nothing",
    "kitchen-export": "--task_name=nothing",
    "kitchen-view": "--domain_name=nothing",
}

# Work that takes long, or needs a GL library.
LEFT_OUT = {"list", "measure", "novideo", "video", "workers"}

LARGE = "9" * 5_000
NESTED = "[" * 100_000
NUMBERS = ["0", "1", "2", "3", "-1", "1_0", "٣", "9" * 9, "9" * 12, "9" * 20, "9" * 40, "9" * 400, LARGE]
NOT_NUMBERS = ["", " ", "nan", "inf", "-inf", "1e400", "1.5", "1e3", "0x10", "1,,2", "[1]"]
TEXTS = ["", " ", "\0", "--", "=", "a\nb", "\udcff", "ü" * 300, "x" * 50_000, "../..", "/dev/null", "None", "{}", "%s"]
PATHS = ["nowhere/at/all", "file", "file/inside", "/proc/none", "/dev/full", "x" * 300, "recording", "empty", "\udcff"]
PATHS += ["/dev/zero", "fifo"]
OBJECTS = [
    NESTED,
    "{",
    "[1]",
    "null",
    '{"a": ' * 3_000,
    '{"threshold": ' + LARGE + "}",
    '{"disable_env_checker": true}',
]
OBJECTS += [
    json.dumps({name: value}) for name in ("threshold", "goals", "thresold") for value in (1e999, None, [[1]], "x")
]
OBJECTS += ['{"num_envs": -1}', '{"hidden": [1e400]}', '{"learning_rate": 1' + "0" * 400 + "}", '{"": {"": {}}}']
POLICIES = [
    "expert(",
    "expert(speed=" + "-" * 50_000 + "1)",
    "expert(sped=1)",
    "trained(file='file')",
    "trained(file='/dev/zero')",
    "trained(file='fifo')",
    "os:abort_",
    ":",
]
POLICIES += [
    "expert(speed=__import__('os'))",
    "trained(file=1e400)",
    "zero()",
    "zero(x=1)",
    "random()(",
    "a:b:c",
    "trained",
]
EPISODES = ["0-99999999999", "5-0", "0,0,0", "-1", ",", "0-" + LARGE, "all,all", "٣"]
BY_NAME = {"policy": POLICIES, "episodes": EPISODES}
BY_TYPE = {
    Path: PATHS,
    Mapping[str, typing.Any]: OBJECTS,
    int: NUMBERS,
    float: NUMBERS,
    bool: ["", "true", "0", "maybe"],
}


def values_of(field, kind):
    """Odd values of a flag: those of its name or type where there are any, and now and then any others."""
    odd = BY_NAME.get(field.name) or next((BY_TYPE[key] for key in BY_TYPE if kind in (key, key | None)), TEXTS)
    others = st.sampled_from([*NOT_NUMBERS, *TEXTS]) | st.text(max_size=20)
    return st.one_of(*[st.sampled_from(odd)] * 4, others)


@st.composite
def command_lines(draw):
    """Name of a command and its arguments: one or two odd values, a flag of another name, or a stray word."""
    name = draw(st.sampled_from(sorted(COMMANDS)))
    hints = typing.get_type_hints(COMMANDS[name].settings)
    fields = [field for field in dataclasses.fields(COMMANDS[name].settings) if field.name not in LEFT_OUT]
    known = st.sampled_from(fields).flatmap(
        lambda field: values_of(field, hints[field.name]).map(lambda value: f"--{field.name}={value}")
    )
    near = st.sampled_from(sorted({*OPTIONS, *RENAMED} - LEFT_OUT)).flatmap(
        lambda flag: st.sampled_from([f"--{flag}s=1", f"--{flag[1:]}", f"--no{flag}"])
    )
    stray = st.sampled_from([*TEXTS, "-", "-x", "--no", "--flagfile=/dev/zero", "--" + "seed" * 5_000, "--undefok=x"])
    odd = draw(st.lists(st.one_of(*[known] * 6, near, stray), min_size=1, max_size=2))
    return name, [*TINY[name], *odd, *([REFUSED[name]] if name in REFUSED else [])]


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


def run(name, arguments):
    """Runs a command as a process would, where what cannot be encoded is written escaped; returns status and stderr."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", "backslashreplace") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = COMMANDS[name].main(arguments)
    err.seek(0)
    return status, err.read()


def check(folder, line):
    name, arguments = line
    before = peak_memory()
    folder.joinpath("new").mkdir(exist_ok=True)
    for path in folder.joinpath("new").iterdir():
        path.unlink()
    with contextlib.chdir(folder):
        status, err = run(name, arguments)
    if status:
        assert status in (1, 2)
        assert re.fullmatch(rf"{name}: [^\n]+\n", err)
        assert len(err) < 1_100
    else:
        assert err == ""
    assert peak_memory() - before < GIBIBYTE


GIBIBYTE = 2**20  # In the unit of ru_maxrss [KiB]


def peak_memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


ODD = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
}


@settings(max_examples=30, **ODD)
@given(line=command_lines())
def test_odd_arguments_end_in_one_line(folder, line):
    check(folder, line)


@pytest.mark.slow
@settings(max_examples=500, **ODD)
@given(line=command_lines())
def test_many_odd_arguments_end_in_one_line(folder, line):
    check(folder, line)

"""Flags from the fields of a settings dataclass: their values, their errors, and their help."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import pytest
from absl import flags
from help_text import flag_lines

from kitchen_suite.cli.command import Command
from kitchen_suite.settings import Flag, JsonFile, OutputFolder, VideoFile, Width

Count = Annotated[int, Flag("Number of things.", minimum=1, maximum=100)]
Rate = Annotated[float, Flag("Things per second.", minimum=0.1)]
Measure = Annotated[str, Flag("What is measured.", choices=("speed", "soak"))]
Seed = Annotated[int, Flag("First seed.", minimum=0, unset="drawn")]
Arguments = Annotated[Mapping[str, Any], Flag("Arguments, as a JSON object.")]
Counts = Annotated[tuple[int, ...], Flag("Numbers of things.", minimum=1)]
Paths = Annotated[tuple[Path, ...], Flag("Folders.")]
Resume = Annotated[bool, Flag("Continue.")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    resume: Resume = False
    folders: Paths = ()
    counts: Counts = ()
    arguments: Arguments = dataclasses.field(default_factory=dict)
    seed: Seed | None = None
    other_seed: Seed | None = dataclasses.field(default=None, metadata={"unset": "the first"})
    measure: Measure = "speed"
    rate: Rate = 25.0
    count: Count = 3
    output: OutputFolder
    json: JsonFile | None = None
    video: VideoFile | None = None
    width: Width = 640


COMMAND = Command(name="kitchen-test", description="Tests.\n", settings=Settings, job="")


def test_arguments_become_settings_of_their_types():
    given = "--output=a --resume --folders=a,b --counts=2,4 --seed=0 --measure=soak --rate=12.5 --count=5 --width=64"
    assert COMMAND.parse([*given.split(), '--arguments={"threshold": 0.1}', "--video=a.mp4"]) == Settings(
        output=Path("a"),
        resume=True,
        folders=(Path("a"), Path("b")),
        counts=(2, 4),
        seed=0,
        measure="soak",
        rate=12.5,
        count=5,
        width=64,
        arguments={"threshold": 0.1},
        video=Path("a.mp4"),
    )


def test_defaults_are_those_of_the_settings_after_every_use():
    COMMAND.parse(["--output=b", "--count=5", "--resume", '--arguments={"threshold": 0.1}'])
    assert COMMAND.parse(["--output=a"]) == Settings(output=Path("a"))
    assert COMMAND.parse(["--output=a", "--resume", "--noresume"]) == Settings(output=Path("a"))


BAD = {
    "--count=0": "must be at least 1",
    "--count=101": "must be at most 100",
    "--count=1.5": "'1.5' is not an integer",
    "--count": "Missing value for flag --count",
    "--counts=1,0": "must be at least 1",
    "--rate=fast": "'fast' is not a number",
    "--rate=nan": "must be finite",
    "--measure=time": "must be one of speed, soak",
    "--arguments={": "not JSON",
    "--arguments=a.json": 'write "$(cat a.json)"',
    "--arguments=[1]": "must be a JSON object",
    "--resume=perhaps": "must be true or false, or the flag alone",
    "--output=": "is empty",
    "--output=file": "is not a folder",
    "--json=.": "is not a file",
    "--video=film.avi": "must be a file that ends with .mp4",
    "--video=nowhere/film.mp4": "there is no folder 'nowhere' that may be written to",
    "--width=641": "must be even",
    "--flagfile=file": "there is no flag --flagfile",
}


@pytest.mark.parametrize("argument", BAD)
def test_a_value_that_is_refused_is_named_with_the_reason(argument, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("--output=a")
    with pytest.raises(flags.Error) as caught:
        COMMAND.parse(["--output=folder", argument])
    assert BAD[argument] in str(caught.value)


def test_help_lists_flags_in_the_order_of_their_definition_with_defaults():
    lines = flag_lines(COMMAND.parse(["--help"]))
    assert [*lines][:6] == ["output", "json", "video", "width", "count", "rate"]
    assert [*lines][-2:] == ["help", "version"]
    assert lines["output"] == "Folder to write to. Required."
    assert lines["count"] == "Number of things. Default: 3."
    assert lines["seed"] == "First seed. Default: drawn."
    assert lines["other_seed"] == "First seed. Default: the first."
    assert (lines["arguments"], lines["resume"]) == ("Arguments, as a JSON object.", "Continue.")

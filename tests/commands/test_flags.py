"""Flags from the fields of a settings dataclass: their values, their errors, and their help."""

# ruff: noqa: RUF009, each call makes a field of its own

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from absl import flags
from help_text import flag_lines

from kitchen_suite.commands.command import Command
from kitchen_suite.settings import check_even, check_file, flag, output_flag, video_flag


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    output: Path = output_flag()
    json: Path | None = flag("Results.", None, check=check_file)
    video: Path | None = video_flag(None)
    width: int = flag("Width.", 640, check=check_even)
    count: int = flag("Number of things.", 3, minimum=1, maximum=100)
    rate: float = flag("Things per second.", 25.0, minimum=0.1)
    measure: str = flag("What is measured.", "speed", choices=("speed", "soak"))
    seed: int | None = flag("First seed.", None, minimum=0, unset="drawn")
    arguments: Mapping[str, Any] = flag("Arguments, as a JSON object.", {})
    counts: tuple[int, ...] = flag("Numbers of things.", (), minimum=1)
    folders: tuple[Path, ...] = flag("Folders.", ())
    resume: bool = flag("Continue.", False)


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
    "--arguments={": "cannot be read as JSON",
    f"--arguments={'[' * 800}{']' * 800}": "nested deeper than 64 levels",
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


def test_help_lists_flags_in_the_order_of_the_fields_with_defaults():
    lines = flag_lines(COMMAND.parse(["--help"]))
    assert [*lines][:6] == ["output", "json", "video", "width", "count", "rate"]
    assert [*lines][-2:] == ["help", "version"]
    assert lines["output"] == "Folder to write to. Required."
    assert lines["count"] == "Number of things. Default: 3."
    assert lines["seed"] == "First seed. Default: drawn."
    assert (lines["arguments"], lines["resume"]) == ("Arguments, as a JSON object.", "Continue.")

"""Every fenced block of README and docs runs as it stands; `docs_blocks.py` explains the marks."""

import importlib.metadata
import itertools
import re
import shlex
import shutil

import pytest
import stand_ins
from docs_blocks import (
    INTERPRETERS,
    PAGES,
    PARSED_MARKS,
    PARSED_PROGRAMS,
    PYTEST_MARKS,
    ROOT,
    Block,
    blocks_of,
    make_programs,
    run,
)
from packaging.requirements import Requirement

pytestmark = pytest.mark.full

BLOCKS = [block for page in PAGES for block in blocks_of(page)]
_COMMAND = re.compile(r"`(kitchen-\w+) ([^`]+)`")


def groups():
    """Yields the blocks of each page that have the same marks, in their order: they share a folder."""
    runnable = [block for block in BLOCKS if block.language]
    in_order = sorted(runnable, key=lambda block: (block.page, block.marks, block.line))
    for (page, marks), blocks in itertools.groupby(in_order, key=lambda block: (block.page, block.marks)):
        selected_by = [getattr(pytest.mark, mark) for mark in marks if mark in PYTEST_MARKS]
        yield pytest.param([*blocks], id=" ".join((page.name, *marks)), marks=selected_by)


def test_languages_and_marks_are_known():
    assert {block.language for block in BLOCKS} <= {"", *INTERPRETERS}
    assert {mark for block in BLOCKS for mark in block.marks} <= {*PYTEST_MARKS, *PARSED_MARKS}


@pytest.mark.parametrize("blocks", [*groups()])
def test_blocks_run(blocks, tmp_path):
    parsed = set(blocks[0].marks) & set(PARSED_MARKS)
    programs = make_programs(tmp_path / "programs", ("pip", *(PARSED_PROGRAMS if parsed else ())))
    # Blocks run in the checkout; `docs` is a copy, since scripts there write beside themselves.
    folder = tmp_path / "checkout"
    shutil.copytree(ROOT / "docs", folder / "docs", ignore=shutil.ignore_patterns("pictures", "__pycache__"))
    for block in blocks:
        output = run(block, folder, programs)
        assert block.marks or "GLFWError" not in output, f"{block.page.name}:{block.line}"


@pytest.mark.parametrize(
    "block", [block for block in BLOCKS if "ci" in block.marks], ids=lambda block: f"{block.page.name}:{block.line}"
)
def test_ci_runs_the_block(block):
    lines = (ROOT / ".ci" / "stage").read_text(encoding="utf-8").splitlines()
    assert set(block.code.splitlines()) <= {line.strip() for line in lines}


def test_commands_in_the_text_are_parsed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands = [found for page in PAGES for found in _COMMAND.findall(page.read_text(encoding="utf-8"))]
    assert len({*commands}) > 9
    for name, arguments in dict.fromkeys(commands):
        stand_ins.check_command(name, *shlex.split(arguments))


def test_the_commands_of_the_workflow_are_parsed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (block,) = [block for block in BLOCKS if "runs-on:" in block.code]
    assert len(block.code.splitlines()) <= 10
    commands = [shlex.split(line) for line in re.findall(r"- run: (.*)", block.code)]
    assert [command[0] for command in commands] == ["pip", "kitchen-evaluate", "kitchen-compare"]
    for name, *arguments in commands[1:]:
        stand_ins.check_command(name, *arguments)


def test_a_requirement_that_is_not_installed_is_found(tmp_path):
    programs = make_programs(tmp_path / "programs", ("pip",))
    with pytest.raises(AssertionError, match="no-such-package is not installed here"):
        run(Block(ROOT / "README.md", 1, "sh", (), "pip install no-such-package\n"), tmp_path, programs)


def test_an_unknown_flag_of_a_long_command_is_found(tmp_path):
    programs = make_programs(tmp_path / "programs", ("kitchen-train",))
    block = Block(ROOT / "README.md", 1, "sh", ("hours",), "kitchen-train --output=a --nun_steps=1\n")
    with pytest.raises(AssertionError, match="did you mean --num_steps"):
        run(block, tmp_path, programs)


def test_the_way_round_on_python_3_13_installs_all_requirements():
    (block,) = [block for block in BLOCKS if "--no-deps 'dm-control" in block.code]
    first, second = (stand_ins.named_requirements(shlex.split(line)[2:]) for line in block.code.splitlines())
    installed = {need.name.lower() for need in second}
    to_follow = [need.name for need in first]
    while to_follow:
        name = to_follow.pop()
        if name.lower() not in installed:
            installed.add(name.lower())
            needs = [Requirement(text) for text in importlib.metadata.requires(name) or ()]
            to_follow += [need.name for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]
    assert {need.name for need in stand_ins.suite_requirements()} <= installed

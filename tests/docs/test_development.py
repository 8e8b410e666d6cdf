"""The page on the design names files and functions that exist, and that the described calls enter."""

import ast
import re
import textwrap

import pytest
import test_layers
import walks

ROOT = walks.trees.ROOT
PAGE = (ROOT / "docs" / "development" / "design.md").read_text(encoding="utf-8")

# Sections that follow a call through the code, with the walks that make the call.
ANSWERS = {
    "Where the reward of the kitchen is computed": "reward",
    "How a flag becomes an effect": "flag",
    "What a reset of one of many environments does": "masked_reset",
    "How a receipt is checked": "receipt",
}


def section(title):
    """Returns the text below a heading."""
    return PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]


def steps(title):
    """Returns the pairs of file and function in the numbered list of a section."""
    numbered = re.findall(r"^\d+\. .*$", section(title), re.MULTILINE)
    pairs = [re.match(r"\d+\. `([\w/]+\.py)`: `([\w.]+)` ", line).groups() for line in numbered]
    assert len(pairs) > 1
    return pairs


def functions(path):
    """Returns the qualified names of the functions and methods of a file."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    methods = {
        f"{cls.name}.{each.name}"
        for cls in body
        if isinstance(cls, ast.ClassDef)
        for each in cls.body
        if isinstance(each, ast.FunctionDef)
    }
    return methods | {each.name for each in body if isinstance(each, ast.FunctionDef)}


def test_the_map_lists_the_packages_in_the_order_of_their_imports():
    rows = re.findall(r"^\| (`.*?) \|", section("Map"), re.MULTILINE)
    names = [re.sub(r"^kitchen_suite/|/$|\.py$", "", name) for row in rows for name in re.findall("`(.+?)`", row)]
    assert names[: len(test_layers.ORDER)] == [*test_layers.ORDER]
    assert {*names} == {*test_layers.ORDER, *test_layers.BESIDE, *test_layers.GROUND} - {""}


def test_files_that_the_page_names_exist():
    named = {*re.findall(r"`([\w/]+/\w+\.py)`", PAGE)}
    assert len(named) > len(ANSWERS)
    assert {name for name in named if not (ROOT / name).is_file()} == set()


@pytest.mark.parametrize("title", ANSWERS)
def test_an_answer_names_functions_of_the_files_beside_them(title):
    pairs = steps(title)
    assert [pair for pair in pairs if pair[1] not in functions(ROOT / pair[0])] == []


@pytest.mark.full
@pytest.mark.parametrize("title", ANSWERS)
def test_the_described_call_enters_the_functions_of_an_answer(title):
    entered = walks.walk(ROOT, ANSWERS[title]).entered
    assert {*steps(title)} - {*entered} == set()


@pytest.mark.parametrize("name", ["reset", "start", "act", "advance"])
def test_the_page_quotes_the_order_of_resets_and_control_steps(name):
    source = (ROOT / "tasks" / "episode" / "runner.py").read_text(encoding="utf-8")
    (runner,) = (each for each in ast.parse(source).body if getattr(each, "name", "") == "EpisodeRunner")
    (method,) = (each for each in runner.body if getattr(each, "name", "") == name)
    # Without its docstring.
    body = source.splitlines()[method.body[1].lineno - 1 : method.end_lineno]
    quoted = section("The order of a reset and of a control step")
    assert f"```\n{textwrap.dedent(chr(10).join(body))}\n```" in quoted

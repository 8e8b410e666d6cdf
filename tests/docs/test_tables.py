"""The tables of the pages are current."""

import re

import pytest
from docs_blocks import ROOT
from docs_scripts import load_script

PAGES = [page for page in sorted((ROOT / "docs").rglob("*.md")) if "<!-- table: " in page.read_text(encoding="utf-8")]
# Their tables are made from environments of every domain, control mode and observation type.
SLOW_PAGES = ("control_modes.md", "entities.md", "observations.md", "variations.md")
# Their tables are made from modules that import PyTorch.
TORCH_PAGES = ("learning_from_data.md", "reinforcement_learning.md")
MARKS = dict.fromkeys(SLOW_PAGES, pytest.mark.full) | dict.fromkeys(TORCH_PAGES, pytest.mark.torch)


@pytest.fixture(scope="module")
def tables():
    return load_script("scripts/tables")


def test_every_table_is_used(tables):
    used = {name for page in PAGES for name in re.findall(r"<!-- table: (\w+) -->", page.read_text(encoding="utf-8"))}
    assert used == set(tables.TABLES)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=MARKS.get(page.name, ())) for page in PAGES],
    ids=lambda path: path.name,
)
def test_tables_are_current(tables, page):
    text = page.read_text(encoding="utf-8")
    assert text == tables.with_tables(text), "run: python docs/scripts/tables.py"


@pytest.mark.full
def test_the_observation_table_has_the_59_numbers_in_order(tables):
    rows = [row.split("|")[1].strip() for row in tables.TABLES["observation"]().splitlines()[2:]]
    spans = [[int(end) for end in row.split("-")] for row in rows]
    assert [number for ends in spans for number in range(ends[0], ends[-1] + 1)] == list(range(59))


@pytest.mark.full
def test_the_actions_of_control_modes_have_the_bounds_of_their_specs(tables):
    rows = [[cell.strip(" `") for cell in row.split("|")] for row in tables.TABLES["control_modes"]().splitlines()[2:]]
    bounds = {row[1]: row[5] for row in rows}
    assert bounds["joint_velocity"] == bounds["ee_delta_pose"] == "[-1, 1]"
    assert "microwave_table [-1, 1]" in bounds["joint_offset"]

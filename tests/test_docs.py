"""The tables of the pages are current, and their links resolve; `test_docs_blocks.py` runs their examples."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), *sorted(ROOT.glob("*.md"))]


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("docs_build", ROOT / "docs" / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_table_is_used(build):
    used = {name for page in PAGES for name in re.findall(r"<!-- table: (\w+) -->", page.read_text(encoding="utf-8"))}
    assert used == set(build.TABLES)


# Their tables are made from environments of every domain, control mode and observation type.
SLOW_PAGES = ("control_modes.md", "observations.md")


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.thorough) if page.name in SLOW_PAGES else page for page in PAGES],
    ids=lambda path: path.name,
)
def test_tables_are_current(build, page):
    text = page.read_text(encoding="utf-8")
    assert text == build.with_tables(text), "run: python docs/build.py tables"


def anchors_of(page):
    """Returns the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = link.partition("#")
        if "://" not in link:
            target = page.parent / file if file else page
            assert target.exists(), link
            assert not anchor or anchor in anchors_of(target), link


def test_the_index_lists_every_page():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")} - {"index.md"}
    assert set(re.findall(r"\]\(([\w/]+\.md)\)", index)) == pages


def test_the_observation_table_has_the_59_rows_in_order(build):
    rows = build.TABLES["observation"]().splitlines()[2:]
    assert [int(row.split("|")[1]) for row in rows] == list(range(59))

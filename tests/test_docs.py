"""The tables of the pages are current, their links resolve, and their examples run."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = re.compile(r"```python\n(.*?)```", re.DOTALL)
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("*.md"))]


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("docs_build", ROOT / "docs" / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_table_is_used(build):
    used = {name for page in PAGES for name in re.findall(r"<!-- table: (\w+) -->", page.read_text(encoding="utf-8"))}
    assert used == set(build.TABLES)


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_tables_are_current(build, page):
    text = page.read_text(encoding="utf-8")
    assert text == build.with_tables(text), "run: python docs/build.py tables"


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    for link in links:
        if "://" not in link:
            assert (page.parent / link).exists(), link


def test_the_observation_table_has_the_59_rows_in_order(build):
    rows = build.TABLES["observation"]().splitlines()[2:]
    assert [int(row.split("|")[1]) for row in rows] == list(range(59))


@pytest.mark.parametrize(
    "block",
    [block for page in PAGES for block in EXAMPLE.findall(page.read_text(encoding="utf-8"))],
)
def test_python_examples_run(block):
    exec(compile(block, "example", "exec"), {})

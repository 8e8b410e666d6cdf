"""Links of the pages resolve, and what the pages name exists; `test_blocks.py` runs their examples."""

import configparser
import re

from docs_blocks import ROOT

DOCS = ROOT / "docs"
# They describe both forms, and earlier ones.
EXEMPT = ("CHANGELOG.md", "releasing.md")
# CONTRIBUTING.md says when they are needed.
EXTRAS_OF_DEVELOPERS = {"test"}
PAGES = [*sorted(DOCS.rglob("*.md")), *sorted(ROOT.glob("*.md"))]


def anchors_of(page):
    """Returns the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(page):
    """Yields the links of a page to files and headings that do not exist."""
    for link in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = link.partition("#")
        if "://" not in link:
            target = page.parent / file if file else page
            if not target.exists() or (anchor and anchor not in anchors_of(target)):
                yield link


def test_links_lead_somewhere(tmp_path):
    assert {page.name: found for page in PAGES if (found := [*broken_links(page)])} == {}
    page = tmp_path / "page.md"
    page.write_text("# One\n[a](#one) [b](#two) [c](none.md)\n", encoding="utf-8")
    assert [*broken_links(page)] == ["#two", "none.md"]


def test_the_page_on_installation_lists_the_extras_of_users():
    page = (DOCS / "guide" / "installation.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg", encoding="utf-8")
    assert listed == {*config["options.extras_require"]} - EXTRAS_OF_DEVELOPERS


def test_files_that_the_pages_name_exist():
    # Those of an earlier commit, `git show COMMIT:FILE`, are gone.
    named = re.compile(r"(?<![\w/:])docs/[\w/]+\.(?:py|md|ipynb|json)\b")
    pages = [*PAGES, ROOT / "setup.cfg", ROOT / "mkdocs.yml", *(DOCS.rglob("*.py"))]
    # The change log also names files of earlier versions.
    for page in (page for page in pages if page.name != "CHANGELOG.md"):
        for name in named.findall(page.read_text(encoding="utf-8")):
            assert (ROOT / name).is_file(), f"{page.name}: {name}"


def test_pages_install_the_suite_in_one_form():
    """From a checkout until a release, whose name pip then knows."""
    forms = set()
    for page in (page for page in [*PAGES, *DOCS.rglob("*.py"), *DOCS.rglob("*.ipynb")] if page.name not in EXEMPT):
        text = page.read_text(encoding="utf-8")
        forms |= {*re.findall(r"pip install (?:-e )?'?(\.|kitchen-suite)(?=[\['\s])", text)}
    assert len(forms) == 1


def test_no_two_pages_of_the_site_have_one_name():
    names = [path.stem for path in DOCS.rglob("*.md") if path.parent.name != "experiments"]
    assert [name for name in names if names.count(name) > 1] == []

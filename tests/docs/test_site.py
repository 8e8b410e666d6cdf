"""The documentation site: it builds without a warning, its links resolve, and every public name has an entry."""

import html
import html.parser
import importlib
import os
import re
import subprocess
import sys
import urllib.parse
import zlib

import pytest
from docs_blocks import ROOT
from docs_scripts import load_script
from test_public_names import PUBLIC

reference_pages = load_script("scripts/reference_pages")
LOADED = {"img": "src", "script": "src", "link": "href", "source": "src", "video": "src", "iframe": "src"}


class Links(html.parser.HTMLParser):
    """The anchors of a page, what it links to, and what a browser loads to show it."""

    def __init__(self, page):
        super().__init__()
        self.anchors, self.links, self.loaded = set(), [], []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.anchors |= {values[name] for name in ("id", "name") if values.get(name)}
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        if values.get(LOADED.get(tag)) and values.get("rel") != "canonical":
            self.loaded.append(values[LOADED[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site."""
    folder = tmp_path_factory.mktemp("site")
    # No proxy answers there: a build that asks the internet fails.
    unreachable = dict.fromkeys(("http_proxy", "https_proxy", "all_proxy"), "http://127.0.0.1:9")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | unreachable, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site):
    """The links of all pages but that for missing pages, which is shown under any address."""
    return {page: Links(page) for page in site.rglob("*.html") if page.name != "404.html"}


def inventory(site):
    """The names that have an entry in the reference, as other sites may link to them."""
    *header, entries = (site / "objects.inv").read_bytes().split(b"\n", 4)
    assert header[0].startswith(b"# Sphinx inventory")
    return {line.split(" ")[0] for line in zlib.decompress(entries).decode().splitlines()}


def test_the_reference_knows_the_public_modules():
    assert set(reference_pages.modules()) == {f"kitchen_suite{name}" for name in PUBLIC}


@pytest.mark.parametrize("name", PUBLIC)
def test_the_reference_knows_the_public_names(name):
    module = f"kitchen_suite{name}"
    named = importlib.import_module(module).__all__
    expected = {f"{module}.{each}" for each in named} - {f"kitchen_suite{each}" for each in PUBLIC}
    assert set(reference_pages.public_names(module)) == expected


@pytest.mark.clients
def test_every_public_name_has_an_entry(site):
    expected = {
        name for module in reference_pages.modules() for name in (module, *reference_pages.public_names(module))
    }
    assert len(expected) > 60
    assert expected <= inventory(site)


def test_the_reference_has_what_the_pages_on_custom_parts_import():
    pages = [ROOT / "docs" / "guide" / f"{name}.md" for name in ("your_task", "extending")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    imported = {
        f"{module}.{name}"
        for module, names in re.findall(r"^from (kitchen_suite[\w.]*) import ([\w, ]+)", text, re.MULTILINE)
        for name in names.split(", ")
    }
    documented = {name for module in reference_pages.modules() for name in reference_pages.public_names(module)}
    assert len(imported) > 5
    assert {name.strip() for name in imported} <= {*documented, *reference_pages.modules()}


@pytest.mark.clients
def test_entities_have_constructors_and_long_signatures_are_wrapped(site):
    entities = (site / "reference" / "kitchen_suite.entities.html").read_text(encoding="utf-8")
    for name in ("Cabinet", "Robot", "Kettle"):
        section = entities.partition(f'id="kitchen_suite.entities.{name}"')[2].partition("</h2>")[2]
        assert "visuals" in section.partition("</pre>")[0], name
    signature = (site / "reference" / "kitchen_suite.gymnasium_env.html").read_text(encoding="utf-8")
    signature = signature.partition('id="kitchen_suite.gymnasium_env.SuiteEnv"')[2].partition("</pre>")[0]
    assert signature.count("\n") > 15


@pytest.mark.clients
def test_every_link_resolves(pages):
    for page, found in pages.items():
        for link in [*found.links, *found.loaded]:
            url = urllib.parse.urlsplit(link)
            if url.scheme in ("", "file") and not url.netloc:
                target = (page.parent / urllib.parse.unquote(url.path)).resolve() if url.path else page
                assert target.is_file(), f"{page.name}: {link}"
                anchor = urllib.parse.unquote(url.fragment)
                assert not anchor or target.suffix != ".html" or anchor in pages[target].anchors, f"{page.name}: {link}"


@pytest.mark.clients
def test_pages_are_shown_without_the_internet(site, pages):
    assert len(pages) > 40
    for page, found in pages.items():
        assert not [url for url in found.loaded if urllib.parse.urlsplit(url).netloc], page.name
    styles = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.css"))
    assert "url(http" not in styles
    assert "@import" not in styles


@pytest.mark.clients
def test_files_that_pages_link_to_can_be_read_on_the_site(site, pages):
    shown = site / "examples" / "my_domain.py.html"
    assert "../examples/my_domain.py.html" in pages[site / "guide" / "quick_reference.html"].links
    text = html.unescape(re.sub(r"<[^>]+>", "", shown.read_text(encoding="utf-8")))
    assert (ROOT / "docs" / "examples" / "my_domain.py").read_text(encoding="utf-8").rstrip() in text


@pytest.mark.clients
def test_the_start_page_has_the_text_of_the_readme_and_its_image(site, pages):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    start = site / "index.html"
    for heading in re.findall(r"^## (.*)$", readme, re.MULTILINE):
        assert f">{html.escape(heading)}<" in start.read_text(encoding="utf-8")
    images = set(re.findall(r"!\[[^\]]*\]\(docs/([^)]+)\)", readme))
    assert images
    assert images <= {*pages[start].loaded}


@pytest.mark.clients
def test_the_site_has_no_scripts_nor_results_of_experiments_but_those_linked_to(site):
    assert not [*site.rglob("*.py"), *(site / "experiments" / "results").rglob("*.npz")]


@pytest.mark.clients
def test_pages_of_the_guide_have_descriptions_of_their_own(site):
    texts = [page.read_text(encoding="utf-8") for page in (site / "guide").glob("*.html")]
    found = [re.search(r'<meta name="description" content="([^"]*)"', text)[1] for text in texts]
    assert len(set(found)) == len(found) > 20


@pytest.mark.clients
def test_marks_of_blocks_are_not_shown(pages):
    for page in pages:
        assert "<p>```" not in page.read_text(encoding="utf-8"), page.name


@pytest.mark.clients
def test_paragraphs_with_a_subject_are_shown_as_paragraphs(site):
    text = (site / "reference" / "kitchen_suite.tasks.html").read_text(encoding="utf-8")
    assert "<strong>Start:</strong> the robot bent over the counter" in text
    assert '<details class="' not in text


@pytest.mark.clients
def test_the_help_of_every_command_is_there(site):
    text = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    for name in ("rollout", "record", "replay", "train", "play", "evaluate"):
        assert f'id="kitchen-{name}"' in text
    assert text.count("Flags:") >= 7

"""Hooks of the documentation site, which `mkdocs.yml` names.

They make the pages of the reference, and adapt to MkDocs what the pages have for GitHub.
"""

import posixpath
import re
import shutil
import sys
import tempfile
from collections.abc import Set
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # Documents the checkout, also where another version is installed.

import reference_pages  # noqa: E402

# Pages at the top of the repository that the site has, too.
_TOP_PAGES = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
# Pages of pictures, which have the whole width.
_WIDE_PAGES = ("gallery.md",)
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)")
_FENCE = re.compile(r"^(\s*```\w+) .*$", re.MULTILINE)
_CODE = re.compile(r"^(\s*)```.*?^\1```$", re.MULTILINE | re.DOTALL)
_NESTED = re.compile(r"^((?:  )+)(?=- )", re.MULTILINE)
# Removed when the process ends.
_packages = tempfile.TemporaryDirectory(prefix="kitchen-suite-docs-")


@event_priority(100)  # Before mkdocstrings makes its handler.
def on_config(config: MkDocsConfig) -> None:
    """Assembles the package as it is installed, since its parts are in three folders, and has it documented."""
    package = Path(_packages.name) / "kitchen_suite"
    for folder, source in (("", "kitchen_suite"), ("entities", "entities"), ("tasks", "tasks")):
        shutil.copytree(ROOT / source, package / folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.npz"))
    config.plugins["mkdocstrings"].config.handlers["python"]["paths"] = [_packages.name]


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Adds the pages of the reference, and those at the top of the repository."""
    pages = {name: (ROOT / source).read_text(encoding="utf-8") for source, name in _TOP_PAGES.items()}
    for name, text in (pages | reference_pages.pages()).items():
        files.append(File.generated(config, name, content=text))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Returns a page's text for MkDocs: plain fences, nested lists by four spaces, links that the site has."""
    if page.file.generated_by and page.file.src_uri not in _TOP_PAGES.values():
        return markdown  # Of the reference, made for MkDocs.
    if page.file.src_uri in _WIDE_PAGES:
        page.meta["hide"] = ["navigation", "toc"]
    sources = {file.src_uri for file in files if file.inclusion.is_included()}
    is_top = page.file.src_uri in _TOP_PAGES.values()
    folder = "" if is_top else posixpath.join("docs", posixpath.dirname(page.file.src_uri))
    code = {}

    def without_code(match: re.Match[str]) -> str:
        code[key := f"<!-- code {len(code)} -->"] = _FENCE.sub(r"\1", match[0])
        return key

    text = _CODE.sub(without_code, markdown)
    text = _NESTED.sub(lambda match: match[1] * 2, text)
    text = _LINK.sub(lambda match: _link(match[1], match[2], folder, sources), text)
    for key, block in code.items():
        text = text.replace(key, block)
    return text


def _link(text: str, target: str, folder: str, sources: Set[str]) -> str:
    """Returns a link as the site has it; of files that are not in the site, the text alone."""
    if "://" in target or target.startswith("#"):
        return f"[{text}]({target})"
    path, mark, anchor = target.partition("#")
    full = (ROOT / folder / path).resolve().relative_to(ROOT).as_posix()
    name = _TOP_PAGES.get(full, full.removeprefix("docs/"))
    if name not in sources:
        return text
    address = posixpath.relpath(name, folder.removeprefix("docs").strip("/") or ".")
    return f"[{_title(full) if text == path else text}]({address}{mark}{anchor})"


def _title(page: str) -> str:
    """Returns the heading of a page, which says more than the name of its file."""
    return (ROOT / page).read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")

"""Hooks of the documentation site, which `mkdocs.yml` names.

They make the pages of the reference, and adapt to MkDocs what the pages have for GitHub. The file is an extension of
mkdocstrings, too: in the suite's docstrings a paragraph may begin with its subject, as in `Reward: one for each task`,
and go on in indented lines, which the parser of Google style would take for a boxed remark.
"""

import posixpath
import re
import shutil
import sys
import tempfile
from collections.abc import Set
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

SCRIPTS = Path(__file__).resolve().parent
ROOT = SCRIPTS.parent.parent
sys.path[:0] = [str(ROOT), str(SCRIPTS)]  # Documents the checkout, also where another version is installed.

import reference_pages  # noqa: E402

# Pages at the top of the repository that the site has, too.
_TOP_PAGES = {"CHANGELOG.md": "development/changelog.md", "CONTRIBUTING.md": "development/contributing.md"}
# Pages of pictures, which have the whole width.
_WIDE_PAGES = ("domains/gallery.md",)
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
    site_folder = posixpath.dirname(page.file.src_uri)
    folder = "" if is_top else posixpath.join("docs", site_folder)
    code = {}

    def without_code(match: re.Match[str]) -> str:
        code[key := f"<!-- code {len(code)} -->"] = _FENCE.sub(r"\1", match[0])
        return key

    text = _CODE.sub(without_code, markdown)
    text = _NESTED.sub(lambda match: match[1] * 2, text)
    text = _LINK.sub(lambda match: _link(match[1], match[2], folder, site_folder, sources), text)
    for key, block in code.items():
        text = text.replace(key, block)
    return text


def _link(text: str, target: str, folder: str, site_folder: str, sources: Set[str]) -> str:
    """Returns a link as the site has it; of files that are not in the site, the text alone.

    Args:
      text: of the link.
      target: of the link, relative to the page's folder in the repository.
      folder: the page's folder in the repository.
      site_folder: the page's folder in the site.
      sources: pages and pictures of the site.
    """
    if "://" in target or target.startswith("#"):
        return f"[{text}]({target})"
    path, mark, anchor = target.partition("#")
    full = (ROOT / folder / path).resolve().relative_to(ROOT).as_posix()
    name = _TOP_PAGES.get(full, full.removeprefix("docs/"))
    if name not in sources:
        return text
    address = posixpath.relpath(name, site_folder or ".")
    return f"[{_title(full) if text == path else text}]({address}{mark}{anchor})"


def _title(page: str) -> str:
    """Returns the heading of a page, which says more than the name of its file."""
    return (ROOT / page).read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


# A subject, its text, and the indented lines after it; sections such as `Args:` have no text on their first line.
_PARAGRAPH = re.compile(r"^([A-Z][\w -]*): (\S.*(?:\n {2,}\S.*)*)$", re.MULTILINE)


def with_paragraphs(docstring: str) -> str:
    """Returns a docstring in which paragraphs with a subject are Markdown, the subject in bold letters."""
    before, mark, sections = docstring.partition("\nArgs:\n")

    def paragraph(match: re.Match[str]) -> str:
        text = re.sub(r"\s+", " ", match[2])
        return f"\n**{match[1]}:** {text}\n"

    return _PARAGRAPH.sub(paragraph, before) + mark + sections


class ComposerConstructors(griffe.Extension):
    """Documents `_build`, which composer's entities have in place of `__init__`, as the constructor."""

    def on_class(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Adds the constructor of a class that has been loaded."""
        if isinstance(build := cls.members.get("_build"), griffe.Function) and "__init__" not in cls.members:
            init = griffe.Function("__init__", parameters=build.parameters, docstring=build.docstring)
            init.lineno, init.endlineno = build.lineno, build.endlineno
            cls.set_member("__init__", init)


class DocstringParagraphs(griffe.Extension):
    """Applies `with_paragraphs` to the docstrings of all objects."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrites the docstring of an object that has been loaded."""
        if obj.docstring:
            obj.docstring.value = with_paragraphs(obj.docstring.value).strip()

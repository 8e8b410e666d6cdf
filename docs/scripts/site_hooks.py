"""Hooks of the documentation site, which `mkdocs.yml` names.

They make the pages of the reference, a page for each file of the repository that a page links to, and adapt to MkDocs
what the pages have for GitHub. The file is also an extension of mkdocstrings: in the suite's docstrings a paragraph may
begin with its subject, as in `Reward: one for each task`, and go on in indented lines, which the parser of Google style
would take for a boxed remark.
"""

import json
import logging
import posixpath
import re
import shutil
import sys
import tempfile
import textwrap
from collections.abc import Iterator, Set
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

SCRIPTS = Path(__file__).resolve().parent
ROOT = SCRIPTS.parent.parent
sys.path[:0] = [str(ROOT), str(SCRIPTS)]  # Documents the checkout, also where another version is installed.

import reference_pages  # noqa: E402

# Pages at the top of the repository that the site has as well.
_TOP_PAGES = {
    ".github/SECURITY.md": "development/security.md",
    "CHANGELOG.md": "development/changelog.md",
    "CONTRIBUTING.md": "development/contributing.md",
}
# The place in the start page where the site has the sections of README.md; it has a beginning of its own.
_README = "<!-- README.md -->\n"
# Pages of images, which have the whole width.
_WIDE_PAGES = ("domains/gallery.md",)
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
# A badge, or any other image that a browser would load from another site; a badge is itself the text of a link.
_FOREIGN_IMAGE = re.compile(r"\[!\[[^\]]*\]\(https?:[^)]*\)\]\([^)]*\)\n?|!\[[^\]]*\]\(https?:[^)]*\)\n?")
_FENCE = re.compile(r"^(\s*```\w+) .*$", re.MULTILINE)
_CODE = re.compile(r"^([ \t]*)```.*?^\1```$", re.MULTILINE | re.DOTALL)
_NESTED = re.compile(r"^((?:  )+)(?=- )", re.MULTILINE)
# Languages of the files that are shown as pages, by the end of their name; all others are plain text.
_LANGUAGES = {".py": "python", ".yaml": "yaml", ".json": "json"}
_log = logging.getLogger("mkdocs.hooks.site_hooks")
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
    """Adds the pages of the reference, those at the top of the repository, and the files that pages link to."""
    pages = {name: (ROOT / source).read_text(encoding="utf-8") for source, name in _TOP_PAGES.items()}
    for name, text in (pages | reference_pages.pages()).items():
        files.append(File.generated(config, name, content=text))
    known = {_source(file.src_uri) for file in files if not file.inclusion.is_excluded()}
    for source in sorted({*_linked_files(files)} - known):
        page = File.generated(config, _shown(source), content=_file_page(ROOT / source))
        page.inclusion = InclusionLevel.NOT_IN_NAV
        files.append(page)


def _source(name: str) -> str:
    """Returns the path in the repository of a page of the site, or of another file there."""
    return next((source for source, page in _TOP_PAGES.items() if page == name), f"docs/{name}")


def _shown(source: str) -> str:
    """Returns the name of the page that shows a file of the repository."""
    return f"{source.removeprefix('docs/')}.md"


def _linked_files(files: Files) -> Iterator[str]:
    """Yields the files of the repository to which the pages link, by their paths."""
    pages = [
        _source(file.src_uri) for file in files if file.src_uri.endswith(".md") and not file.inclusion.is_excluded()
    ]
    for page in ("README.md", *pages):
        path = ROOT / page
        if path.is_file():  # Not of the reference, whose links mkdocstrings makes.
            for _, _, target in _LINK.findall(_CODE.sub("", path.read_text(encoding="utf-8"))):
                linked = (path.parent / target.partition("#")[0]).resolve()
                if linked.is_file() and linked.name != "README.md":
                    yield linked.relative_to(ROOT).as_posix()


def _file_page(path: Path) -> str:
    """Returns the page that shows a file; the search of the site leaves it out."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"]]
        body = "\n\n".join(source if kind == "markdown" else _fenced(source, "python") for kind, source in cells)
    else:
        body = _fenced(text, _LANGUAGES.get(path.suffix, "text"))
    name = path.relative_to(ROOT).as_posix()
    return f"---\ntitle: {path.name}\nsearch: {{exclude: true}}\n---\n`{name}` in the repository:\n\n{body}\n"


def _fenced(code: str, language: str) -> str:
    """Returns code between fences that it does not contain."""
    return f"~~~~~~~~{language}\n{code.rstrip()}\n~~~~~~~~"


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Returns a page's text for MkDocs: plain fences, nested lists by four spaces, links that the site has."""
    name = page.file.src_uri
    if page.file.generated_by and name not in _TOP_PAGES.values():
        return markdown  # Made for MkDocs.
    if name in _WIDE_PAGES:
        page.meta["hide"] = ["navigation", "toc"]
    sources = {file.src_uri for file in files if file.inclusion.is_included()}
    page.meta.setdefault("description", _description(markdown))
    text = _adapted(markdown, _source(name), name, sources)
    if _README in text:
        readme = (ROOT / "README.md").read_text(encoding="utf-8")
        readme = readme[readme.index("\n## ") :]
        text = text.replace(_README, _adapted(readme, "README.md", name, sources))
    return text


def _description(markdown: str) -> str:
    """Returns the first sentences of a page as plain text, which search engines show."""
    paragraphs = [each for each in _CODE.sub("", markdown).split("\n\n") if re.match(r"\s*[\w`\"[]", each)]
    text = _LINK.sub(r"\2", paragraphs[0] if paragraphs else "").replace("`", "").replace('"', "'")
    return textwrap.shorten(text, 200, placeholder=" ...")


def _adapted(markdown: str, source: str, name: str, sources: Set[str]) -> str:
    """Returns the text of a file of the repository as that of a page of the site.

    Args:
      markdown: the text.
      source: path of the file in the repository.
      name: of the page of the site.
      sources: pages and images of the site.
    """
    code = {}

    def without_code(match: re.Match[str]) -> str:
        code[key := f"<!-- code {len(code)} of {source} -->"] = _FENCE.sub(r"\1", match[0])
        return key

    text = _CODE.sub(without_code, markdown)
    text = _FOREIGN_IMAGE.sub("", text)
    text = _NESTED.sub(lambda match: match[1] * 2, text)
    text = _LINK.sub(lambda match: _link(match, source, name, sources), text)
    for key, block in code.items():
        text = text.replace(key, block)
    return text


def _link(match: re.Match[str], source: str, name: str, sources: Set[str]) -> str:
    """Returns a link or an image as the site has it; what leads nowhere is a warning, which ends a strict build.

    Args:
      match: of `_LINK`.
      source: path in the repository of the file that has the link.
      name: of the page of the site.
      sources: pages and images of the site.
    """
    mark, text, target = match.groups()
    if "://" in target or target.startswith("#"):
        return match[0]
    path, hash_mark, anchor = target.partition("#")
    full = (ROOT / posixpath.dirname(source) / path).resolve().relative_to(ROOT).as_posix()
    pages = (_TOP_PAGES.get(full, full.removeprefix("docs/")), _shown(full))
    if full == "README.md":
        pages = ("index.md",)
    linked = next((page for page in pages if page in sources), None)
    if linked is None:
        _log.warning("%s links to %s, which the site does not have", source, full)
        return text
    address = posixpath.relpath(linked, posixpath.dirname(name) or ".")
    shown = _title(full) if text == path and full.endswith(".md") else text
    return f"{mark}[{shown}]({address}{hash_mark}{anchor})"


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

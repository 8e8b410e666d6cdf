"""An extension of mkdocstrings for the suite's docstrings, which `mkdocs.yml` names.

In the suite's docstrings a paragraph may begin with its subject, as in `Reward: one for each task`, and go on in
indented lines. The parser of Google style would take it for a boxed remark.
"""

import re
from typing import Any

import griffe

# A subject, its text, and the indented lines after it; sections such as `Args:` have no text on their first line.
_PARAGRAPH = re.compile(r"^([A-Z][\w -]*): (\S.*(?:\n {2,}\S.*)*)$", re.MULTILINE)


def with_paragraphs(docstring: str) -> str:
    """Returns a docstring in which paragraphs with a subject are Markdown, the subject in bold letters."""
    before, mark, sections = docstring.partition("\nArgs:\n")

    def paragraph(match: re.Match[str]) -> str:
        text = re.sub(r"\s+", " ", match[2])
        return f"\n**{match[1]}:** {text}\n"

    return _PARAGRAPH.sub(paragraph, before) + mark + sections


class DocstringParagraphs(griffe.Extension):
    """Applies `with_paragraphs` to the docstrings of all objects."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrites the docstring of an object that has been loaded."""
        if obj.docstring:
            obj.docstring.value = with_paragraphs(obj.docstring.value).strip()

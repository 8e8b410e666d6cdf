"""Parts of docstrings, for the tables of the pages."""

import inspect
import re


def first_line(documented: object) -> str:
    """Returns the first line of a docstring, with the bars escaped for a cell of a table."""
    return (inspect.getdoc(documented) or "").splitlines()[0].replace("|", "\\|")


def attributes(documented: type) -> dict[str, str]:
    """Returns the names and texts of the section `Attributes` of a docstring."""
    section = (inspect.getdoc(documented) or "").split("Attributes:\n", 1)[1]
    entries = re.findall(r"^ {2}(\w+): (.*(?:\n {4,}.*)*)", section, re.MULTILINE)
    return {name: re.sub(r"\s+", " ", text) for name, text in entries}

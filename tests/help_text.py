"""Reads the text of `--help`."""

import re


def flag_lines(text):
    """Help of each flag by its name, in the order of the text, with single spaces."""
    _, listed = text.split("\nFlags:\n")
    rows = re.findall(r"^  (?:-\w,)?--(?:\[no\])?(\w+): (.*(?:\n {4}.*)*)", listed, flags=re.MULTILINE)
    return {name: " ".join(help.split()) for name, help in rows}

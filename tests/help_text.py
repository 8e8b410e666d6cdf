"""Reads the text of `--help`."""

import re


def flag_lines(text):
    """Help of each flag by its name, in the order of the text, with single spaces."""
    _, flags = text.split("\nFlags:\n")
    rows = re.findall(r"^  --(\w+) +(.*(?:\n {24}.*)*)", flags, flags=re.MULTILINE)
    assert f"\n{flags}".count("\n  --") == len(rows)
    return {name: " ".join(text.split()) for name, text in rows}

"""Names from files of strangers: what a command prints, and Markdown and LaTeX made of it, is text alone."""

import re

import pytest
from helpers.errors import refused

from kitchen_suite import checks
from kitchen_suite.episodes.report import in_markdown, paragraph, print_line, table

ESCAPE = "\x1b[31mred\x1b]0;title\x07"
BIDI = "\u202etxt.exe\u2066"
MARKUP = "<img src=x onerror=alert(1)>|<b>x</b>|[a](javascript:x)`*"


@pytest.mark.parametrize("text", [ESCAPE, BIDI, "a\rb", "a\x00b", "\x9b31m", "\u200b"])
def test_terminal_escapes_are_printed_by_their_codes(text, capsys):
    print_line(f"before {text}\nafter")
    lines = capsys.readouterr().out.split("\n")
    assert lines[1:] == ["after", ""]
    assert lines[0].isprintable()
    # Nothing is lost.
    assert lines[0].encode().decode("unicode_escape") == f"before {text}"


@pytest.mark.parametrize("text", ["plain", "top_drawer (0.1 to 0.2) 5 %", "Küche ≥ 3", "[0.1, 0.2]"])
def test_ordinary_text_stays_as_it_is(text, capsys):
    print_line(text)
    assert capsys.readouterr().out == f"{text}\n"
    assert in_markdown(text) == text


def test_a_markdown_table_has_as_many_cells_as_its_heading_and_no_html():
    rows = table(("policy", MARKUP), [(MARKUP, "1")], "markdown").splitlines()
    assert [row.count("|") for row in rows] == [3, 3, 3]
    assert not re.search(r"[<>`*]|\]\(", "".join(rows))


def test_a_paragraph_of_latex_is_a_comment_in_every_line():
    lines = paragraph(f"one {ESCAPE}\ntwo\x0bthree\r\\input\u2028x", "latex")
    assert all(line.startswith("% ") for line in re.split(r"[\n\r\x0b\x0c\u2028\u2029\x85]", lines))


def test_errors_quote_names_in_one_printable_line():
    with refused(ValueError, "did you mean"):
        checks.choice("kettel", ["kettle"], "task")
    assert checks.shortened(f"{ESCAPE}\n{BIDI}").isprintable()

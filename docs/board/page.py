"""The page of the board, made from its rows."""

from collections.abc import Mapping, Sequence
from typing import Any

from rows import BOARDS, Receipt, Row
from tabulate import tabulate

from kitchen_suite.episodes.report import in_markdown
from kitchen_suite.evaluation.paired_scores import PairedScore, adjusted, paired_scores
from kitchen_suite.evaluation.text import p_text

_INTRODUCTION = """\
# Board

Success of policies under the suite's own [protocols](../guide/protocols.md). Each number has a
[receipt](../guide/evaluation.md#receipts): `kitchen-replay` plays its episodes again on your machine, without the
policy. [Add a row](../board/README.md) says what a receipt proves and what it does not, and how your policy gets a row.

`python docs/board/make.py` makes this page from the folders of `docs/board/`, and refuses a row whose receipts do not
hold. *Difference* is the score by which a table is in order, less that of its first row, in percentage points and in
[the same episodes](../guide/comparison.md#what-an-interval-says); intervals are of 95 %, and p is adjusted for the
number of differences. What is *observed* and the *cost of training* are what the rows state.
"""

# Names of the scores that have a column, where they were measured.
_RATES = {"clean_success": "clean success", "success": "success"}


def page(rows: Sequence[Row]) -> str:
    """Returns the page."""
    tables = [section(protocol, rows) for protocol in BOARDS]
    sources = ["## Rows\n", *(_source(row) for row in _ordered(rows))]
    return "\n".join([_INTRODUCTION, *tables, *sources])


def section(protocol: str, rows: Sequence[Row]) -> str:
    """Returns the section of a protocol: its table, in the order of the score."""
    score = BOARDS[protocol].score
    listed = ranking(protocol, rows)
    if not listed:
        return f"## `{protocol}`\n\nThere is no row yet.\n"
    differences = differences_from_best([row.receipts[protocol] for row in listed], score)
    scores = [row.receipts[protocol].evaluation.scores for row in listed]
    rates = [name for name in _RATES if any(name in each for each in scores)]
    cells = [
        (
            f"[{row.statement.title}](#{anchor(row.statement.title)})",
            ", ".join(row.statement.observes) or "nothing",
            *(_rate(each, name) for name in rates),
            *_difference(difference),
            in_markdown(row.statement.cost),
            f"[npz](../board/{row.receipts[protocol].name})",
        )
        for row, each, difference in zip(listed, scores, differences, strict=True)
    ]
    header = ("row", "observed", *(f"{_RATES[name]} [%]" for name in rates), "difference", "p (Holm)")
    header = (*header, "cost of training", "receipt")
    text = tabulate(cells, header, tablefmt="github", disable_numparse=True)
    plan = listed[0].receipts[protocol].evaluation.plan
    count = f"{plan.num_episodes * len(plan.specs)} episodes"
    unit = f"; intervals are those of the mean over {plan.unit}s" if plan.is_sample else ""
    caption = f"{BOARDS[protocol].text} {count}{unit}. In the order of {_RATES[score]}."
    return f"## `{protocol}`\n\n{caption}\n\n{text}\n"


def ranking(protocol: str, rows: Sequence[Row]) -> list[Row]:
    """Returns the rows with a receipt of a protocol, the best first; equal ones by name."""
    score = BOARDS[protocol].score
    listed = [row for row in rows if protocol in row.receipts]
    return sorted(listed, key=lambda row: (-row.receipts[protocol].evaluation.scores[score], row.name))


def differences_from_best(receipts: Sequence[Receipt], score: str) -> list[PairedScore | None]:
    """Returns the score of each receipt less that of the first, in pairs, with p adjusted; None for the first.

    The receipts are of one protocol, in which their episodes are the same.
    """
    best, *others = receipts
    found = {}
    for other in others:
        results, of_best = other.evaluation.results, best.evaluation.results
        pairs = [pair for name in of_best for pair in zip(results[name], of_best[name], strict=True)]
        found[other.row] = paired_scores(pairs, by_condition=best.evaluation.plan.is_sample)[score]
    return [None, *adjusted(found).values()]


def anchor(title: str) -> str:
    """Returns the anchor of a heading, as GitHub makes it."""
    kept = "".join(letter for letter in title.lower() if letter.isalnum() or letter in "_- ")
    return kept.replace(" ", "-")


def _rate(scores: Mapping[str, Any], name: str) -> str:
    """Returns a rate with its interval [%]; empty where it was not measured."""
    if name not in scores:
        return ""
    low, high = (f"{100 * bound:.1f}" for bound in scores["intervals"][name])
    return f"{100 * scores[name]:.1f} ({low} to {high})"


def _difference(score: PairedScore | None) -> tuple[str, str]:
    """Returns the cells of a difference and its p-value."""
    if score is None:
        return "", ""
    low, high = (f"{100 * bound:+.1f}" for bound in score.interval or ())
    return f"{100 * score.difference:+.1f} ({low} to {high})", p_text(score.p_value_holm)


def _ordered(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: row.statement.title)


def _source(row: Row) -> str:
    """Returns the paragraph on how a row was made; its commands have no language, so that no test runs them."""
    stated = row.statement
    lines = "\n".join(stated.commands)
    training, cost, policy = map(in_markdown, (stated.training, stated.cost, stated.policy))
    text = f"Policy {policy} ([source]({stated.link})). {training} Cost of training: {cost}."
    return f"### {stated.title}\n\n{text}\n\n```\n{lines}\n```\n"

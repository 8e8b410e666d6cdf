"""The page of the board, made from its rows."""

from collections.abc import Sequence
from typing import NamedTuple

from rows import BOARDS, Receipt, Row
from tabulate import tabulate

from kitchen_suite import Evaluation
from kitchen_suite.episodes.report import in_markdown
from kitchen_suite.evaluation.paired_scores import PairedScore, adjusted, paired_scores
from kitchen_suite.evaluation.scores import score_sample
from kitchen_suite.evaluation.text import p_text

_INTRODUCTION = """\
# Board

Success of policies under the suite's own [protocols](../guide/protocols.md). Each number links to its
[receipt](../guide/evaluation.md#receipts): `kitchen-replay` plays the episodes again on your machine, without the
policy. [Add a row](../board/README.md) says what a receipt proves and what it does not, and how your policy gets a row.

`python docs/board/make.py` makes this page from the folders of `docs/board/`, and refuses a row whose receipts do not
hold. A *clean success* disturbs nothing else, and no more than 10 N act on the bare arm: see
[Quality](../guide/quality.md). It has no number where a receipt was made without `--quality`. *Difference* is the score
by which a table is in order, less that of its first row, in percentage points and in
[the same episodes](../guide/comparison.md#what-an-interval-says); intervals are of 95 %, and p is adjusted for the
number of differences. What is *observed* and the *cost of training* are what the rows state.
"""

# Scores that have a column, where they were measured.
_RATES = ("clean_success", "success")


class Rate(NamedTuple):
    """A rate, and its interval of 95 %."""

    value: float
    interval: tuple[float, float]


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
    scores = [rates(row.receipts[protocol].evaluation) for row in listed]
    names = sorted({name for each in scores for name in each}, key=lambda name: name != score)
    cells = [
        (
            f"[{row.statement.title}](#{anchor(row.statement.title)})",
            *(_rate(row.receipts[protocol], each.get(name)) for name in names),
            *_difference(difference),
            ", ".join(row.statement.observes) or "nothing",
            in_markdown(row.statement.cost),
        )
        for row, each, difference in zip(listed, scores, differences, strict=True)
    ]
    of_scores = (f"{name.replace('_', ' ')} [%]" for name in names)
    header = ("row", *of_scores, "difference", "p (Holm)", "observed", "cost of training")
    text = tabulate(cells, header, tablefmt="github", disable_numparse=True)
    plan = listed[0].receipts[protocol].evaluation.plan
    count = f"{plan.num_episodes * len(plan.specs)} episodes"
    unit = f"; intervals are those of the mean over {plan.unit}s" if plan.is_sample else ""
    caption = f"{BOARDS[protocol].text} {count}{unit}. In the order of {score.replace('_', ' ')}."
    return f"## `{protocol}`\n\n{caption}\n\n{text}\n"


def rates(evaluation: Evaluation) -> dict[str, Rate]:
    """Returns the rates of an evaluation that were measured, by name; under a sample of kitchens means over them."""
    scores = evaluation.scores
    if evaluation.plan.is_sample:
        by_condition = evaluation.scores_by_condition
        measured = [name for name in _RATES if all(name in each for each in by_condition.values())]
        scores = score_sample(by_condition, measured)
    return {name: Rate(scores[name], tuple(scores["intervals"][name])) for name in _RATES if name in scores}


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


def _rate(receipt: Receipt, rate: Rate | None) -> str:
    """Returns a rate with its interval [%], linked to its receipt; empty where it was not measured."""
    if rate is None:
        return ""
    low, high = (f"{100 * bound:.1f}" for bound in rate.interval)
    return f"[{100 * rate.value:.1f}](../board/{receipt.name}) ({low} to {high})"


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
    policy = in_markdown(stated.policy)
    training = in_markdown(stated.training)
    cost = in_markdown(stated.cost)
    text = f"Policy {policy} ([source]({stated.link})). {training} Cost of training: {cost}."
    return f"### {stated.title}\n\n{text}\n\n```\n{lines}\n```\n"

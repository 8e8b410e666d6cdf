"""Comparisons of policies as text, from what their JSON holds."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite.episodes.report import WIDTH, counted, paragraph, table
from kitchen_suite.evaluation.compare import PairedComparison, all_as_json
from kitchen_suite.evaluation.tables import label, value_text

_INTERVAL = "95 % interval"


def format_comparison(comparison: PairedComparison, table_format: str = "text") -> str:
    """Returns what two policies are compared on, the tables of their scores, and the conclusion.

    `table_format` is one of `report.TABLE_FORMATS`.
    """
    record = comparison.as_json()
    one, other = record["a"]["name"], record["b"]["name"]
    parts = [
        paragraph("\n".join([_heading(record), _policy(record["a"]), _policy(record["b"])]), table_format),
        _score_table(record["scores"], one, other, table_format),
        paragraph(_outcome(record, one, other), table_format),
    ]
    if "conditions" in record:
        success = {name: scores["success"] for name, scores in record["conditions"].items()}
        parts.append(_verdict_table("success by condition", success, one, other, "p_value", table_format))
    if "task_rates" in record:
        parts.append(
            _verdict_table("completed, by task", record["task_rates"], one, other, "p_value_holm", table_format)
        )
    return "\n\n".join(parts)


def format_comparisons(comparisons: Sequence[PairedComparison], table_format: str = "text") -> str:
    """Returns what several policies are compared on, and a table of all pairs."""
    record = all_as_json(comparisons)
    policies = {each[key]["name"]: each[key] for each in record["comparisons"] for key in ("a", "b")}
    rows = []
    for each in record["comparisons"]:
        success = each["scores"]["success"]
        names = f"{each['a']['name']} - {each['b']['name']}"
        rows.append((names, *_verdict_cells(success), p_text(success["p_value"]), p_text(each["p_value_holm"])))
    header = ("success", "first", "second", "difference", _INTERVAL, "wins", "losses", "p", "p (Holm)")
    means = _mean_rows(record["comparisons"])
    parts = [
        paragraph("\n".join([_heading(record), *map(_policy, policies.values())]), table_format),
        table(header, rows, table_format),
        *(table((name, *header[1:5]), lines, table_format) for name, lines in means.items()),
        paragraph(_explained(len(rows)), table_format),
    ]
    return "\n\n".join(parts)


def p_text(p_value: float) -> str:
    """Returns a p-value as tables show it."""
    return f"{p_value:.2g}" if p_value < 0.01 else f"{p_value:.2f}"


def _heading(record: Mapping[str, Any]) -> str:
    what = f"protocol {record['protocol']}" if record["protocol"] else "recordings"
    count = counted(record["episodes"])
    return f"{record['domain_name']}, {what}, {record['variations']}: {count} in pairs, seeds from {record['seed']}"


def _policy(record: Mapping[str, Any]) -> str:
    return record["name"] if record["name"] == record["policy"] else f"{record['name']}: policy {record['policy']}"


def _outcome(record: Mapping[str, Any], one: str, other: str) -> str:
    counts = (
        f"{counted(record['wins'])} that {one} alone succeeds in, {record['losses']} that {other} alone succeeds in, "
        f"{record['ties']} alike; exact McNemar p = {p_text(record['p_value'])}"
    )
    return "\n".join(textwrap.fill(line, WIDTH) for line in (counts, record["conclusion"]))


def _explained(pairs: int) -> str:
    text = f"p (Holm) is adjusted for {pairs} comparisons: below 0.05, one policy of the pair succeeds more often"
    return textwrap.fill(text, WIDTH)


def _score_table(scores: Mapping[str, Mapping[str, Any]], one: str, other: str, table_format: str) -> str:
    rows = []
    for name, row in scores.items():
        p_value = p_text(row["p_value"]) if "p_value" in row else ""
        rows.append((label(name), *_cells(name, row), p_value))
    return table(("score", one, other, "difference", _INTERVAL, "p"), rows, table_format)


def _verdict_table(
    title: str, rates: Mapping[str, Mapping[str, Any]], one: str, other: str, p_value: str, table_format: str
) -> str:
    rows = [(name, str(row["episodes"]), *_verdict_cells(row), p_text(row[p_value])) for name, row in rates.items()]
    p_name = "p (Holm)" if p_value == "p_value_holm" else "p"
    header = (title, "episodes", one, other, "difference", _INTERVAL, "wins", "losses", p_name)
    return table(header, rows, table_format)


def _verdict_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    return (*_cells("success", row), str(row["wins"]), str(row["losses"]))


def _mean_rows(comparisons: Sequence[Mapping[str, Any]]) -> dict[str, list[tuple[str, ...]]]:
    """Returns the rows of all pairs by the label of each mean."""
    rows: dict[str, list[tuple[str, ...]]] = {}
    for each in comparisons:
        for name, row in each["scores"].items():
            if "wins" not in row:
                names = f"{each['a']['name']} - {each['b']['name']}"
                rows.setdefault(label(name), []).append((names, *_cells(name, row)))
    return rows


def _cells(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the scores of both policies, their difference, and its interval."""
    interval = "none"
    if row["interval"] is not None:
        low, high = (_signed(name, bound) for bound in row["interval"])
        interval = f"{low} to {high}"
    return value_text(name, row["a"]), value_text(name, row["b"]), _signed(name, row["difference"]), interval


def _signed(name: str, difference: float) -> str:
    return f"{'+' if difference > 0.0 else ''}{value_text(name, difference)}"

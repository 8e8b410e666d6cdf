"""The tables of the pages on evaluation: the protocols, and the results in docs/benchmarks/evaluation/."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from entity_tables import markdown

from kitchen_suite import suite
from kitchen_suite.evaluation.protocols import PROTOCOLS, Condition, Protocol, domain_protocols

RESULTS = Path(__file__).parent / "benchmarks" / "evaluation"

# The protocol with a table of its own.
_SHIFT = "shift"

_MOST = 7


def protocol_table() -> str:
    """Returns the table of the protocols."""
    rows = [
        (
            f"`{protocol.name}`",
            protocol.follows,
            _domains(protocol),
            "; ".join(dict.fromkeys(_task(condition, protocol.is_general) for condition in protocol.conditions)),
            _arguments(protocol),
            f"{protocol.num_episodes:,}",
            f"{protocol.seed:,}",
            protocol.max_episode_steps or "the domain's",
        )
        for protocol in PROTOCOLS.values()
    ]
    header = (
        "`--protocol`",
        "follows; fixes",
        "domains",
        "task",
        "arguments",
        "episodes",
        "first seed",
        "control steps",
    )
    return markdown(header, rows)


def _domains(protocol: Protocol) -> str:
    if protocol.is_general:
        return "all"
    return ", ".join(
        domain.name for domain in suite.DOMAINS.values() if protocol.name in domain_protocols(domain.name).protocols
    )


def _task(condition: Condition, is_general: bool) -> str:
    if condition.task_name:
        return f"`{condition.task_name}`"
    return f"`{domain_protocols('kitchen').task_name}`" + ("; elsewhere the domain's default" if is_general else "")


def _arguments(protocol: Protocol) -> str:
    if protocol.name == _SHIFT:
        return f"{len(protocol.conditions)} conditions: see below"
    arguments = protocol.conditions[0].task_kwargs
    return ", ".join(f"`{name}={json.dumps(value)}`" for name, value in arguments.items()) or "none"


def condition_table() -> str:
    """Returns the table of the conditions of `shift`."""
    rows = [
        (
            f"`{condition.name}`",
            ", ".join(condition.task_kwargs.get("variations", ())) or "none",
            condition.task_kwargs.get("variation_split", "none").replace("_", "-"),
        )
        for condition in PROTOCOLS[_SHIFT].conditions
    ]
    return markdown(("condition", "groups that vary", "values"), rows)


def results() -> Iterator[Mapping[str, Any]]:
    """Yields the committed results, in the order of the protocols and of the files' names.

    These are POLICY_PROTOCOL.json or POLICY_TASK_PROTOCOL.json; each result has the policy's name in its file's.
    """
    for name in PROTOCOLS:
        for path in sorted(RESULTS.glob(f"*_{name}.json")):
            result = json.loads(path.read_text(encoding="utf-8"))
            yield {**result, "policy": path.stem.partition("_")[0]}


def result_table() -> str:
    """Returns the table of the results of all protocols but `shift`; a row for each condition."""
    rows = [
        (
            f"`{result['protocol']}`",
            f"`{name}`",
            result["policy"],
            result["num_episodes"],
            *(rate(condition, f"p{number}") for number in range(1, _MOST + 1)),
            with_interval(condition, "mean_tasks"),
            with_interval(condition, "success"),
            _score(result, condition),
            f"{condition['order_entropy']:.2f}",
            f"{condition['control_steps']:.0f}",
        )
        for result in results()
        if result["protocol"] != _SHIFT
        for name, condition in result["conditions"].items()
    ]
    rates = (f"p{number}" for number in range(1, _MOST + 1))
    means = ("mean tasks", "success", "score", "order entropy", "steps")
    header = ("protocol", "condition", "policy", "episodes", *rates, *means)
    return markdown(header, rows)


def shift_table() -> str:
    """Returns the table of the results of `shift`: p4, with its interval, of each policy in each condition."""
    found = {result["policy"]: result["conditions"] for result in results() if result["protocol"] == _SHIFT}
    rows = [
        (f"`{condition.name}`", *(with_interval(each[condition.name], "p4") for each in found.values()))
        for condition in PROTOCOLS[_SHIFT].conditions
    ]
    return markdown(("condition", *(f"{policy}: p4" for policy in found)), rows)


def task_table() -> str:
    """Returns the table of the rates of single tasks, in the first condition of each result."""
    found = [*results()]
    tasks = sorted({task for result in found for task in result["task_rates"]})
    rows = [
        (f"`{result['protocol']}`", result["policy"], *(_task_rate(result["task_rates"].get(task)) for task in tasks))
        for result in found
    ]
    return markdown(("protocol", "policy", *tasks), rows)


def rate(condition: Mapping[str, Any], name: str) -> str:
    """Returns a number of a result; nothing if it has none of that name."""
    return f"{condition[name]:.3g}" if name in condition else ""


def with_interval(condition: Mapping[str, Any], name: str) -> str:
    """Returns a mean of a result with its interval."""
    low, high = condition["intervals"][name]
    return f"{condition[name]:.3g} ({low:.2f} to {high:.2f})"


def _score(result: Mapping[str, Any], condition: Mapping[str, Any]) -> str:
    score = PROTOCOLS[result["protocol"]].score
    return f"{condition[score.name]:.3g}" if score else ""


def _task_rate(row: Mapping[str, Any] | None) -> str:
    return f"{row['completed']} of {row['asked']}" if row else ""


EVALUATION_TABLES: dict[str, Callable[[], str]] = {
    "protocols": protocol_table,
    "shift_conditions": condition_table,
    "evaluation_results": result_table,
    "evaluation_shift": shift_table,
    "evaluation_tasks": task_table,
}

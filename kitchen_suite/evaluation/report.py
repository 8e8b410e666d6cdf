"""The scores of an evaluation as plain text."""

from collections.abc import Mapping
from typing import Any

from kitchen_suite.benchmarks.report import Table

# Scores that are means in a unit of their own; all others are rates.
_MEANS = {
    "mean_tasks": "mean tasks",
    "mean_progress": "mean progress",
    "control_steps": "control steps",
    "score": "score",
    "d4rl_score": "D4RL score",
}


def heading(description: Mapping[str, Any]) -> str:
    """Returns the line above the scores: what is evaluated, and on which episodes."""
    each = " of each condition" if len(description["conditions"]) > 1 else ""
    return (
        f"{description['domain_name']}, policy {description['policy']}, protocol {description['protocol']}: "
        f"{_episodes(description['num_episodes'])}{each}, seeds from {description['seed']}"
    )


def condition(name: str, task_name: str, num_episodes: int, scores: Mapping[str, Any]) -> str:
    """Returns the tables of a condition: its scores with intervals, and the rates of single tasks if there are any.

    Args:
      name: of the condition.
      task_name: its task.
      num_episodes: number of its episodes.
      scores: as `episode_results.score_episodes` returns them.
    """
    title = task_name if name == task_name else f"{name} ({task_name})"
    intervals = scores["intervals"]
    rows = [(_label(key), _text(key, scores[key]), _interval(key, intervals[key])) for key in intervals]
    if "order_entropy" in scores:
        rows.append(("order entropy [bit]", f"{scores['order_entropy']:.2f}", ""))
    parts = [Table((title, _episodes(num_episodes), "95 % interval"), rows).format("simple")]
    if "task_rates" in scores:
        tasks = [
            (task, _percent(row["rate"]), _interval("rate", row["interval"]), f"{row['completed']} of {row['asked']}")
            for task, row in scores["task_rates"].items()
        ]
        parts.append(Table(("task", "completed", "95 % interval", "where asked"), tasks).format("simple"))
    if diverged := scores["diverged_seeds"]:
        episodes = _episodes(len(diverged))
        parts.append(
            f"the physics diverged in {episodes}, counted as failures that completed nothing: seeds {diverged}"
        )
    return "\n\n".join(parts)


def summary(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns the table of all conditions: a row for each, without intervals."""
    keys = list(dict.fromkeys(key for each in scores.values() for key in each["intervals"]))
    rows = [
        (name, *(_text(key, each[key]) if key in each else "" for key in keys), _entropy(each))
        for name, each in scores.items()
    ]
    return Table(("condition", *map(_label, keys), "order entropy [bit]"), rows).format("simple")


def _episodes(count: int) -> str:
    return f"{count} episode" + ("s" if count > 1 else "")


def _entropy(scores: Mapping[str, Any]) -> str:
    return f"{scores['order_entropy']:.2f}" if "order_entropy" in scores else ""


def _label(key: str) -> str:
    return _MEANS.get(key, key)


def _text(key: str, value: float) -> str:
    return f"{value:.4g}" if key in _MEANS else _percent(value)


def _interval(key: str, interval: list[float] | None) -> str:
    if interval is None:
        return "none"
    low, high = (_text(key, bound) for bound in interval)
    return f"{low} to {high}"


def _percent(value: float) -> str:
    return f"{100 * value:.1f} %"

"""Scores of an evaluation as text."""

from collections.abc import Mapping
from typing import Any

from kitchen_suite.episodes.report import counted, table
from kitchen_suite.evaluation import quality
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.policies import PolicyRef

# Beginnings of the names of scores that are means in a unit of their own; all others are rates.
_MEANS = ("mean_", "control_steps", "score", "d4rl_score", "subtasks", *quality.INFOS)
_ENTROPY = "order entropy [bit]"


def format_heading(plan: EvaluationPlan) -> str:
    """Returns the line above the scores: what is evaluated, and on which episodes."""
    first, varied = plan.first, {spec.variations for spec in plan.specs.values()}
    each = " of each condition" if len(plan.specs) > 1 else ""
    variations = first.variations if len(varied) == 1 else "variations by condition"
    played = f"{first.domain_name}, policy {PolicyRef.parse(first.policy).without_file}, protocol {plan.protocol}"
    return f"{played}, {variations}: {counted(plan.num_episodes)}{each}, seeds from {first.seed}"


def format_scores(name: str, task_name: str, num_episodes: int, scores: Mapping[str, Any]) -> str:
    """Returns the tables of a condition: its scores with intervals, and the rates of single tasks if there are any."""
    title = task_name if name == task_name else f"{name} ({task_name})"
    intervals = scores["intervals"]
    rows = [(_label(key), _text(key, scores[key]), _interval(key, intervals[key])) for key in intervals]
    if entropy := _entropy(scores):
        rows.append((_ENTROPY, entropy, ""))
    parts = [table((title, counted(num_episodes), "95 % interval"), rows)]
    if "task_rates" in scores:
        tasks = []
        for task, row in scores["task_rates"].items():
            counts = f"{row['completed']} of {row['asked']}"
            tasks.append((task, _text("rate", row["rate"]), _interval("rate", row["interval"]), counts))
        parts.append(table(("task", "completed", "95 % interval", "where asked"), tasks))
    if diverged := scores["diverged_seeds"]:
        where = f"the physics diverged in {counted(len(diverged))}"
        parts.append(f"{where}, counted as failures that completed nothing: seeds {diverged}")
    return "\n\n".join(parts)


def format_summary(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns the table of all conditions: a row for each, without intervals."""
    keys = list(dict.fromkeys(key for each in scores.values() for key in each["intervals"]))
    rows = []
    for name, each in scores.items():
        rows.append((name, *(_text(key, each[key]) if key in each else "" for key in keys), _entropy(each)))
    return table(("condition", *map(_label, keys), _ENTROPY), rows)


def _entropy(scores: Mapping[str, Any]) -> str:
    return f"{scores['order_entropy']:.2f}" if "order_entropy" in scores else ""


def _label(key: str) -> str:
    return key.replace("_", " ").replace("d4rl", "D4RL")


def _text(key: str, value: float) -> str:
    return f"{value:.4g}" if key.startswith(_MEANS) else f"{100 * value:.1f} %"


def _interval(key: str, interval: list[float] | None) -> str:
    if interval is None:
        return "none"
    low, high = (_text(key, bound) for bound in interval)
    return f"{low} to {high}"


def format_overall(overall: Mapping[str, float]) -> str:
    """Returns the table of the scores over all conditions."""
    return table(("over all conditions", ""), [(_label(name), f"{value:.4g}") for name, value in overall.items()])

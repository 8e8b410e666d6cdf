"""Scores of an evaluation as text."""

from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite.episodes.report import counted, paragraph, table
from kitchen_suite.evaluation import quality
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.policies import PolicyRef

# Beginnings of the names of scores that are means in a unit of their own; all others are rates.
_MEANS = ("mean_", "control_steps", "score", "d4rl_score", "subtasks", *quality.INFOS)
_ENTROPY = "order entropy [bit]"
_INTERVAL = "95 % interval"

# Names of conditions in a cell of a table.
_MOST_NAMES = 6

# Scores that have their intervals in the table of all conditions.
_WITH_INTERVALS = ("mean_tasks", "mean_progress", "success")


def format_heading(plan: EvaluationPlan) -> str:
    """Returns the line above the scores: what is evaluated, and on which episodes."""
    first, varied = plan.first, {spec.variations for spec in plan.specs.values()}
    each = " of each condition" if len(plan.specs) > 1 else ""
    variations = first.variations if len(varied) == 1 else "variations by condition"
    if len(plan.specs) == 1:
        variations = first.circumstances
    played = f"{first.domain_name}, policy {PolicyRef.parse(first.policy).without_file}, protocol {plan.protocol}"
    # Beside the default, what a policy's actions have to mean.
    modes = [spec.argument("control_mode") for spec in plan.specs.values() if spec.has_other_control_mode]
    if modes:
        played = f"{played}, control_mode {' and '.join(dict.fromkeys(modes))}"
    return f"{played}, {variations}: {counted(plan.num_episodes)}{each}, seeds from {first.seed}"


def format_starts(plan: EvaluationPlan, policy: PolicyRef) -> str:
    """Returns that starts vary, and what decides it, for a user's own policy, which may know one; else nothing."""
    varied = {spec.variations for spec in plan.specs.values() if spec.argument("variations")}
    is_own = policy.is_independent_of_tasks or "file" in policy.options
    # Where conditions differ in what varies, nothing can replace it.
    if not is_own or len(varied) != 1 or len({spec.variations for spec in plan.specs.values()}) != 1:
        return ""
    flag = "--variations=none, or variations='none' among the task_kwargs, leaves it out"
    return f"each episode varies ({varied.pop()}): a policy that was trained without this may fail; {flag}"


def format_scores(
    name: str, task_name: str, num_episodes: int, scores: Mapping[str, Any], table_format: str = "text"
) -> str:
    """Returns the tables of a condition: its scores with intervals, and the rates of single tasks if there are any.

    `table_format` is one of `report.TABLE_FORMATS`.
    """
    title = task_name if name == task_name else f"{name} ({task_name})"
    intervals = scores["intervals"]
    rows = [(label(key), value_text(key, scores[key]), _interval(key, intervals[key])) for key in intervals]
    if entropy := _entropy(scores):
        rows.append((_ENTROPY, entropy, ""))
    parts = [table((title, counted(num_episodes), _INTERVAL), rows, table_format)]
    if "task_rates" in scores:
        tasks = []
        for task, row in scores["task_rates"].items():
            counts = f"{row['completed']} of {row['asked']}"
            tasks.append((task, value_text("rate", row["rate"]), _interval("rate", row["interval"]), counts))
        parts.append(table(("task", "completed", _INTERVAL, "where asked"), tasks, table_format))
    parts += _diverged(scores, table_format)
    return "\n\n".join(parts)


def format_summary(scores: Mapping[str, Mapping[str, Any]], table_format: str = "text") -> str:
    """Returns the table of all conditions: a row for each, with the intervals of the success and of the mean."""
    keys = list(dict.fromkeys(key for each in scores.values() for key in each["intervals"]))
    header = ["condition"]
    for key in keys:
        header += [label(key), _INTERVAL] if key in _WITH_INTERVALS else [label(key)]
    rows = []
    for name, each in scores.items():
        cells = [name]
        for key in keys:
            cells.append(value_text(key, each[key]) if key in each else "")
            if key in _WITH_INTERVALS:
                cells.append(_interval(key, each["intervals"][key]) if key in each else "")
        rows.append((*cells, _entropy(each)))
    return table((*header, _ENTROPY), rows, table_format)


def format_episodes(results: Mapping[str, Sequence[EpisodeResult]], table_format: str = "text") -> str:
    """Returns a row for each episode of each condition, by which two evaluations can be paired."""
    rows = [
        (
            result.condition,
            str(result.seed),
            "yes" if result.success else "no",
            f"{result.progress:.4g}",
            str(result.control_steps),
            _completed(result),
        )
        for each in results.values()
        for result in each
    ]
    header = ("condition", "seed", "success", "progress", "control steps", "completed (at control step)")
    return table(header, rows, table_format)


def _completed(result: EpisodeResult) -> str:
    if result.diverged:
        return "the physics diverged"
    steps = sorted((step, name) for name, step in (result.asked or {}).items() if step is not None)
    return ", ".join(f"{name} ({step})" for step, name in steps)


def _entropy(scores: Mapping[str, Any]) -> str:
    return f"{scores['order_entropy']:.2f}" if "order_entropy" in scores else ""


def label(key: str) -> str:
    """Returns the name of a score as tables show it."""
    return key.replace("_", " ").replace("d4rl", "D4RL")


def value_text(key: str, value: float) -> str:
    """Returns the value of a score of a name as tables show it."""
    return f"{value:.4g}" if key.startswith(_MEANS) else f"{100 * value:.1f} %"


def _interval(key: str, interval: list[float] | None) -> str:
    if interval is None:
        return "none"
    low, high = (value_text(key, bound) for bound in interval)
    return f"{low} to {high}"


def format_overall(overall: Mapping[str, float], table_format: str = "text") -> str:
    """Returns the table of the scores over all conditions."""
    rows = [(label(name), f"{value:.4g}") for name, value in overall.items()]
    return table(("over all conditions", ""), rows, table_format)


def format_sample(
    scores: Mapping[str, Any], results: Mapping[str, Sequence[EpisodeResult]], table_format: str = "text"
) -> str:
    """Returns the scores over conditions that are a sample, and how many conditions have how many successes."""
    rows = [
        (label(key), value_text(key, scores[key]), _interval(key, each)) for key, each in scores["intervals"].items()
    ]
    by_count: dict[int, list[str]] = {}
    for name, each in results.items():
        by_count.setdefault(sum(result.success for result in each), []).append(name)
    most = len(next(iter(results.values())))
    counts = []
    for count in range(most, -1, -1):
        names = by_count.get(count, [])
        shown = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
        counts.append((f"{count} of {most}", str(len(names)), shown))
    parts = [
        table(("mean over all conditions", str(len(results)), _INTERVAL), rows, table_format),
        table(("successes", "conditions", "which"), counts, table_format),
        *_diverged(scores, table_format),
    ]
    return "\n\n".join(parts)


def _diverged(scores: Mapping[str, Any], table_format: str) -> list[str]:
    """Returns the paragraph on episodes whose physics diverged; nothing if there are none."""
    seeds = scores["diverged_seeds"]
    if not seeds:
        return []
    where = f"the physics diverged in {counted(len(seeds))}"
    return [paragraph(f"{where}, counted as failures that completed nothing: seeds {seeds}", table_format)]

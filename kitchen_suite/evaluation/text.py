"""Evaluations, comparisons and checks as text: what the commands print, and pages quote."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite import checks
from kitchen_suite.episodes.replay import Verdict
from kitchen_suite.episodes.report import WIDTH, counted, paragraph, table
from kitchen_suite.evaluation import quality
from kitchen_suite.evaluation.check import Check, ReplayedResult
from kitchen_suite.evaluation.compare import PairedComparison, adjusted_p_values, compared_sides
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.methods import Method, MethodComparison
from kitchen_suite.evaluation.paired_scores import RATE, PairedScore, rounded
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.scores import EpisodeResult, Interval
from kitchen_suite.evaluation.sides import Side, circumstances
from kitchen_suite.evaluation.training_seeds import Estimate
from kitchen_suite.gymnasium_env.observations import OF_PICTURES
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.variations.distributions import NONE
from kitchen_suite.versions import machine

# Beginnings of the names of scores that are means in a unit of their own, as measures of quality are; all others are
# rates.
_MEANS = ("mean_", "control_steps", "steps_to_success", "score", "d4rl_score", "subtasks")
_ENTROPY = "order entropy [bit]"
_INTERVAL = "95 % interval"

# Names of conditions in a cell of a table.
_MOST_NAMES = 6

_MAX_LINES = 10  # Episodes that differ of which the text of a check has a line.

_VERDICTS: Mapping[Verdict, str] = {
    "equal": "the receipt holds: all numbers are equal to the bit, and all scores follow from them",
    "other digits": "the scores hold, but not all digits: actions were altered, or this is another machine",
    "altered": "the scores are not those of the replay: the receipt was altered, or this is another machine",
}

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


def format_evaluation(evaluation: Evaluation, table_format: str = "text") -> str:
    """Returns what was evaluated, the tables of all conditions, and those of all together."""
    plan = evaluation.plan
    heading = "\n".join(filter(None, [format_heading(plan), format_changes(plan)]))
    parts = [paragraph(heading, table_format)]
    if not plan.is_sample:
        parts += [format_condition(plan, name, each, table_format) for name, each in evaluation.results.items()]
    return "\n\n".join(filter(None, [*parts, format_totals(evaluation, table_format)]))


def format_condition(
    plan: EvaluationPlan, name: str, results: Sequence[EpisodeResult], table_format: str = "text"
) -> str:
    """Returns the tables of a condition: its scores with intervals, and the rates of single tasks if there are several.

    `table_format` is one of `report.TABLE_FORMATS`.
    """
    scores = plan.scores(results)
    task_name = plan.specs[name].task_name
    title = task_name if name == task_name else f"{name} ({task_name})"
    intervals = scores["intervals"]
    keys = _shown(scores)
    rows = [(label(key), value_text(key, scores[key]), _interval(key, intervals[key])) for key in keys]
    if entropy := _entropy(scores):
        rows.append((_ENTROPY, entropy, ""))
    parts = [table((title, counted(len(results)), _INTERVAL), rows, table_format)]
    if "task_rates" in scores and not _is_of_one_task(scores):
        tasks = []
        for task, row in scores["task_rates"].items():
            counts = f"{row['completed']} of {row['asked']}"
            tasks.append((task, value_text("rate", row["rate"]), _interval("rate", row["interval"]), counts))
        parts.append(table(("task", "completed", _INTERVAL, "where asked"), tasks, table_format))
    parts += _diverged(scores, table_format)
    return "\n\n".join(parts)


def _is_of_one_task(scores: Mapping[str, Any]) -> bool:
    """Returns whether all episodes asked for the same single task, so that several scores are the success."""
    return len(scores.get("task_rates", ())) == 1 and scores["p1"] == scores["success"]


def _shown(scores: Mapping[str, Any]) -> list[str]:
    """Returns the names of the scores that are shown, each number once."""
    repeated = ("p1", "mean_tasks") if _is_of_one_task(scores) else ()
    return [key for key in scores["intervals"] if key not in repeated]


def format_summary(scores: Mapping[str, Mapping[str, Any]], table_format: str = "text") -> str:
    """Returns the table of all conditions: a row for each, with the intervals of the success and of the mean."""
    keys = list(dict.fromkeys(key for each in scores.values() for key in _shown(each)))
    has_entropy = any(_entropy(each) for each in scores.values())
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
        rows.append((*cells, _entropy(each)) if has_entropy else tuple(cells))
    return table((*header, _ENTROPY) if has_entropy else header, rows, table_format)


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
    """Returns the entropy of the order of completed tasks; empty where there is no order."""
    if "order_entropy" not in scores or _is_of_one_task(scores):
        return ""
    return f"{scores['order_entropy']:.2f}"


def label(key: str) -> str:
    """Returns the name of a score as tables show it."""
    return key.replace("_", " ").replace("d4rl", "D4RL")


def value_text(key: str, value: float) -> str:
    """Returns the value of a score of a name as tables show it."""
    return f"{value:.4g}" if key.startswith((*_MEANS, *quality.least_values())) else f"{100 * value:.1f} %"


def _interval(key: str, interval: list[float] | None) -> str:
    if interval is None:
        return "none"
    low, high = (value_text(key, bound) for bound in interval)
    return f"{low} to {high}"


def format_overall(overall: Mapping[str, float], table_format: str = "text") -> str:
    """Returns the table of the scores over all conditions."""
    rows = [(label(name), f"{value:.4g}") for name, value in overall.items()]
    return table(("over all conditions", ""), rows, table_format)


def format_shifts(shifts: Mapping[str, Mapping[str, PairedScore]], control: str, table_format: str = "text") -> str:
    """Returns a table for each score of what conditions change, in pairs with episodes of the control arm."""
    tables = []
    for name in dict.fromkeys(name for scores in shifts.values() for name in scores):
        header = [f"{label(name)}, less that of {control!r} in pairs", "difference", _INTERVAL]
        # In some conditions there may be no episode in which both succeed.
        measured = {condition: scores for condition, scores in shifts.items() if name in scores}
        rows = [
            [_with_count(condition, name, scores), *_cells(scores[name])[2:]] for condition, scores in measured.items()
        ]
        if name == "success":
            header.append("p (Holm)")
            for row, scores in zip(rows, measured.values(), strict=True):
                row.append(p_text(scores[name].p_value_holm))
        tables.append(table(header, rows, table_format))
    return "\n\n".join(tables)


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


def format_totals(evaluation: Evaluation, table_format: str = "text") -> str:
    """Returns the tables of all conditions together; empty where there is one."""
    if len(evaluation.results) == 1:
        return ""
    if evaluation.plan.is_sample:
        parts = [format_sample(evaluation.scores, evaluation.results, table_format)]
    else:
        parts = [format_summary(evaluation.scores_by_condition, table_format)]
    if shifts := evaluation.shifts:
        parts.append(format_shifts(shifts, str(evaluation.plan.control), table_format))
    if overall := evaluation.overall:
        parts.append(format_overall(overall, table_format))
    return "\n\n".join(parts)


def format_latency(evaluation: Evaluation) -> str:
    """Returns how long the policy's answers took; empty where none was played."""
    if evaluation.latency is None:
        return ""
    middle, late = (1_000 * seconds for seconds in evaluation.latency)
    return f"an answer of the policy took {middle:.3g} ms (median), and 95 % at most {late:.3g} ms"


def format_changes(plan: EvaluationPlan) -> str:
    """Returns the values that replace the protocol's, each beside that one; empty without any."""
    if not (changes := plan.changes):
        return ""
    pairs = (f"{name} {_text(value)}, not {_text(own)}" for name, (value, own) in changes.items())
    return f"values replaced: {'; '.join(pairs)}"


def _text(value: Any) -> str:
    return "the default" if value is None else checks.shown(value)


def format_comparison(comparison: PairedComparison, table_format: str = "text") -> str:
    """Returns what two policies are compared on, the tables of their scores, and the conclusion.

    `table_format` is one of `report.TABLE_FORMATS`.
    """
    names = comparison.first.name, comparison.second.name
    parts = [
        paragraph(_compared_heading([comparison]), table_format),
        _score_table(comparison.scores, names, table_format),
        paragraph(_outcome(comparison), table_format),
    ]
    # A row for each condition of a sample would be long, and each has few episodes.
    if len(comparison.pairs) > 1 and not comparison.is_sample:
        success = {name: scores["success"] for name, scores in comparison.scores_by_condition.items()}
        parts.append(_verdict_table("success by condition", success, names, table_format))
    if tasks := comparison.task_rates:
        parts.append(_verdict_table("completed, by task", tasks, names, table_format))
    return "\n\n".join(parts)


def format_comparisons(comparisons: Sequence[PairedComparison], table_format: str = "text") -> str:
    """Returns what several policies are compared on, and a table of all pairs."""
    rows = []
    for each, p_value in zip(comparisons, adjusted_p_values(comparisons), strict=True):
        success = each.scores["success"]
        rows.append((_both_names(each), *_verdict_cells(success), p_text(success.p_value), p_text(p_value)))
    header = ("success", "first", "second", "difference", _INTERVAL, "wins", "losses", "p", "p (Holm)")
    others = _rows_of_other_scores(comparisons)
    parts = [
        paragraph(_compared_heading(comparisons), table_format),
        table(header, rows, table_format),
        *(table((name, *header[1:5]), lines, table_format) for name, lines in others.items()),
        paragraph(_explained(len(rows)), table_format),
    ]
    return "\n\n".join(parts)


def format_methods(comparison: MethodComparison, table_format: str = "text") -> str:
    """Returns what two methods are compared on, tables of their scores and of the differences, and the conclusion.

    The first table has a row a method and a column a score. `table_format` is one of `report.TABLE_FORMATS`.
    """
    scores = comparison.scores.values()
    rows = [
        _method_row(comparison.first, [(score.a, score.unit) for score in scores]),
        _method_row(comparison.second, [(score.b, score.unit) for score in scores]),
    ]
    differences = []
    for name, score in comparison.scores.items():
        value, interval, p_value = score.difference
        cells = _signed(value, score.unit), _signed_interval(interval, score.unit), p_text(p_value)
        differences.append((label(name), *cells))
    one, other = comparison.first.name, comparison.second.name
    parts = [
        paragraph(_methods_heading(comparison), table_format),
        table(("method", "training seeds", *map(label, comparison.scores)), rows, table_format),
        table((f"{one} - {other}", "difference", _INTERVAL, "p"), differences, table_format),
        paragraph(textwrap.fill(comparison.conclusion, WIDTH), table_format),
    ]
    return "\n\n".join(parts)


def _method_row(method: Method, means: Sequence[tuple[Estimate, str]]) -> tuple[str, ...]:
    cells = (f"{_in_unit(mean.value, unit)} ({_span(mean.interval, unit)})" for mean, unit in means)
    return method.name, str(len(method.seeds)), *cells


def _methods_heading(comparison: MethodComparison) -> str:
    """Returns what methods are compared on, and the success of each training seed."""
    methods = comparison.first, comparison.second
    counts = " and ".join(f"{len(each.seeds)} training seeds of {each.name}" for each in methods)
    lines = [f"{_compared_on(comparison.circumstances, 'of each policy')}; {counts}"]
    for method in methods:
        seeds = zip(method.seeds, method.successes, strict=True)
        successes = ", ".join(f"{side.name} {_in_unit(success, RATE)}" for side, success in seeds)
        lines.append(f"{method.name}: success of {successes}")
    return "\n".join([*lines, *_not_replayed(comparison.sides)])


def _span(interval: Interval, unit: str) -> str:
    """Returns an interval as a cell has it beside its number."""
    return "no interval" if interval is None else " to ".join(_in_unit(bound, unit) for bound in interval)


def p_text(p_value: float | None) -> str:
    """Returns a p-value as tables show it; empty where there is none."""
    if p_value is None:
        return ""
    return f"{p_value:.2g}" if p_value < 0.1 else f"{p_value:.2f}"


def _compared_heading(comparisons: Sequence[PairedComparison]) -> str:
    """Returns what is compared on which episodes, a line for each policy, and what nobody has checked."""
    sides = compared_sides(comparisons)
    across = comparisons[0].across
    lines = [_compared_on(circumstances(sides), "in pairs")]
    if across:
        lines.append(f"compared across {', '.join(across)}: pairs have the same seed, and differ in this")
    for side in sides:
        policy = PolicyRef.parse(side.policy).without_file
        own = [] if side.name == policy else [f"policy {policy}"]
        own += [f"{argument} {_value(argument, value)}" for argument, value in side.arguments(across).items()]
        lines.append(f"{side.name}: {', '.join(own)}" if own else side.name)
    return "\n".join([*lines, *_not_replayed(sides)])


def _compared_on(record: Mapping[str, Any], how: str) -> str:
    """Returns the line on the episodes of a comparison, given its `circumstances`."""
    what = f"protocol {record['protocol']}" if record["protocol"] else "recordings"
    count = f"{counted(record['episodes'])} {how}"
    if "unit" in record:
        count = f"{count}, of {record['clusters']} {record['unit']}s, which are the unit"
    return f"{record['domain_name']}, {what}, {record['variations']}: {count}, seeds from {record['seed']}"


def _not_replayed(sides: Sequence[Side]) -> list[str]:
    """Returns a line on the files that were read; nothing if there are none."""
    read = [side.name for side in sides if side.is_read]
    return [f"not replayed, as kitchen-replay does: {', '.join(read)}"] if read else []


def _value(argument: str, value: Any) -> str:
    """Returns the value of an argument of the environments as text."""
    return _text(value or NONE) if argument == "variations" else _text(value)


def _outcome(comparison: PairedComparison) -> str:
    one, other = comparison.first.name, comparison.second.name
    p_value = p_text(comparison.p_value)
    counts = (
        f"{counted(comparison.wins)} that {one} alone succeeds in, {comparison.losses} that {other} alone succeeds in, "
        f"{comparison.ties} alike"
    )
    if comparison.is_sample:
        lead = comparison.leading
        of_sample = (
            f"{lead.wins} {comparison.unit}s in which {one} succeeds more often, {lead.losses} in which {other} does, "
            f"{lead.ties} alike; exact p by permutation of {comparison.unit}s = {p_value}"
        )
        lines = [counts, of_sample, comparison.conclusion]
    else:
        lines = [f"{counts}; exact McNemar p = {p_value}", comparison.conclusion]
    return "\n".join(textwrap.fill(line, WIDTH) for line in lines)


def _explained(pairs: int) -> str:
    text = f"p (Holm) is adjusted for {pairs} comparisons: below 0.05, one policy of the pair succeeds more often"
    return textwrap.fill(text, WIDTH)


def _both_names(comparison: PairedComparison) -> str:
    return f"{comparison.first.name} - {comparison.second.name}"


def _score_table(scores: Mapping[str, PairedScore], names: tuple[str, str], table_format: str) -> str:
    rows = [
        (_with_count(label(name), name, scores), *_cells(score), p_text(score.p_value))
        for name, score in scores.items()
    ]
    return table(("score", *names, "difference", _INTERVAL, "p"), rows, table_format)


def _verdict_table(title: str, rates: Mapping[str, PairedScore], names: tuple[str, str], table_format: str) -> str:
    is_adjusted = any(rate.p_value_holm is not None for rate in rates.values())
    rows = [
        (name, str(rate.episodes), *_verdict_cells(rate), p_text(rate.p_value_holm if is_adjusted else rate.p_value))
        for name, rate in rates.items()
    ]
    header = (title, "episodes", *names, "difference", _INTERVAL, "wins", "losses", "p (Holm)" if is_adjusted else "p")
    return table(header, rows, table_format)


def _verdict_cells(score: PairedScore) -> tuple[str, ...]:
    assert score.verdicts
    return (*_cells(score), str(score.verdicts.wins), str(score.verdicts.losses))


def _rows_of_other_scores(comparisons: Sequence[PairedComparison]) -> dict[str, list[tuple[str, ...]]]:
    """Returns the rows of all pairs by the label of each score but the success."""
    rows: dict[str, list[tuple[str, ...]]] = {}
    for each in comparisons:
        for name, score in each.scores.items():
            if name != "success":
                title = _with_count(_both_names(each), name, each.scores)
                rows.setdefault(label(name), []).append((title, *_cells(score)))
    return rows


def _with_count(title: str, name: str, scores: Mapping[str, PairedScore]) -> str:
    """Returns the title of a score's row, with the number of its episodes where it is not of all."""
    count = scores[name].episodes
    return title if count == scores["success"].episodes else f"{title} ({counted(count)})"


def _cells(score: PairedScore) -> tuple[str, ...]:
    """Returns the scores of both policies, their difference, and its interval."""
    return (
        _in_unit(score.a, score.unit),
        _in_unit(score.b, score.unit),
        _signed(score.difference, score.unit),
        _signed_interval(score.interval, score.unit),
    )


def _in_unit(value: float, unit: str) -> str:
    """Returns a number in its unit, as tables show it."""
    if unit == RATE:
        return f"{100 * rounded(value):.1f} %"
    return f"{rounded(value):.4g} {unit}".rstrip()


def _signed_interval(interval: Interval, unit: str) -> str:
    return "none" if interval is None else " to ".join(_signed(bound, unit) for bound in interval)


def _signed(value: float, unit: str) -> str:
    return f"{'+' if rounded(value) > 0.0 else ''}{_in_unit(value, unit)}"


def format_check_heading(evaluation: Evaluation, dataset: object = None, published: object = None) -> str:
    """Returns the lines above the check of a receipt: what is confirmed or refused, on which episodes, and where.

    Args:
      evaluation: that is checked.
      dataset: the recording whose goals it has, if that has been confirmed.
      published: the file of a result that is the evaluation's, if that has been confirmed.
    """
    plan = evaluation.plan
    subject = format_subject(plan, _caveats(evaluation, dataset))
    lines = [subject, format_heading(plan), *_circumstances(evaluation)]
    if published is not None:
        lines.append(f"the published result {published} is that of the receipt")
    return "\n".join(lines)


def format_subject(plan: EvaluationPlan, caveats: Sequence[str] = ()) -> str:
    """Returns what a receipt's check confirms or refuses: domain, protocol, replaced values, and caveats."""
    parts = [f"{plan.first.domain_name}, protocol {plan.protocol}", *filter(None, [format_changes(plan)]), *caveats]
    return "; ".join(parts)


def _caveats(evaluation: Evaluation, dataset: object) -> list[str]:
    """Returns what the first line says beside the protocol: what nobody has checked, and what needs no policy."""
    lines = []
    if evaluation.plan.resets:
        unknown = "not verified, since their recording is not here: where the goals were taken from"
        lines.append(unknown if dataset is None else f"the goals are those of {dataset}")
    constant, total = evaluation.constant_successes
    if constant:
        lines.append(f"{constant} of {total} successful episodes repeat one action from start to end")
    return lines


def _circumstances(evaluation: Evaluation) -> list[str]:
    """Returns lines on versions and machine, and on what is not verified."""
    first = evaluation.plan.first
    lines = [f"versions: {', '.join(f'{name} {each}' for name, each in first.versions.items())}"]
    given = {name for spec in evaluation.plan.specs.values() for name in spec.task_kwargs}
    if unseen := sorted(given & OF_PICTURES):
        lines.append(f"not verified, since none of the numbers depend on it: {', '.join(unseen)}")
    here = {**first.current_versions, "processor": machine()}
    there: Mapping[str, Any] = {**first.versions, "processor": evaluation.machine}
    differing = [name for name in here if here[name] != there.get(name)]
    return [*lines, *(f"made with {name} {there.get(name)}, here {here[name]}" for name in differing)]


def format_check(plan: EvaluationPlan, check: Check[ReplayedResult]) -> str:
    """Returns the scores of the replayed episodes, how many episodes are equal, which are not, and the verdict."""
    replayed: dict[str, list[EpisodeResult]] = {name: [] for name in plan.specs}
    compared: dict[str, list[ReplayedResult]] = {name: [] for name in plan.specs}
    for episode in check.episodes:
        replayed[episode.condition].append(episode.replayed)
        compared[episode.condition].append(episode)
    if plan.is_sample:
        scores = [format_sample(check.scores, replayed)]
    else:
        scores = [format_condition(plan, name, each) for name, each in replayed.items()]
    lines = [_difference_line(episode) for episode in check.differing[:_MAX_LINES]]
    if len(check.differing) > _MAX_LINES:
        lines.append(f"and {len(check.differing) - _MAX_LINES} further episodes")
    return "\n\n".join([*scores, _check_table(compared), "\n".join([*lines, _VERDICTS[check.verdict]])])


def _check_table(compared: Mapping[str, Sequence[ReplayedResult]]) -> str:
    rows = []
    for name, each in compared.items():
        first = [episode.first for episode in each if episode.first is not None]
        same = sum(episode.scores_alike for episode in each)
        greatest = max(episode.greatest for episode in each)
        equal = len(each) - len(first)
        rows.append((name, str(len(each)), str(equal), str(same), str(min(first, default="none")), f"{greatest:.3g}"))
    return table(("condition", "episodes", "equal", "same result", "first difference", "greatest at the end"), rows)


def _difference_line(episode: ReplayedResult) -> str:
    where = f"{episode.condition}, episode {episode.episode}, seed {episode.seed}"
    found = "; ".join(episode.differences) or "results of other types"
    return f"{where}: {'numbers are equal; ' if episode.first is None else ''}{found}"

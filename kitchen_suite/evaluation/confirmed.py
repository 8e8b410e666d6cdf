"""The subject of an evaluation, or of the check of a receipt, in a line: protocol, replaced values, caveats."""

from collections.abc import Mapping, Sequence
from typing import Any

from kitchen_suite import checks
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.receipts import Trace
from kitchen_suite.evaluation.scores import EpisodeResult


def format_changes(plan: EvaluationPlan) -> str:
    """Returns the values that replace the protocol's, each beside that one; empty without any."""
    if not (changes := plan.changes):
        return ""
    pairs = (f"{name} {_text(value)}, not {_text(own)}" for name, (value, own) in changes.items())
    return f"values replaced: {'; '.join(pairs)}"


def format_subject(plan: EvaluationPlan, caveats: Sequence[str]) -> str:
    """Returns what a receipt's check confirms or refuses: domain, protocol, replaced values, and caveats."""
    parts = [f"{plan.first.domain_name}, protocol {plan.protocol}", *filter(None, [format_changes(plan)]), *caveats]
    return "; ".join(parts)


def constant_successes(
    results: Mapping[str, Sequence[EpisodeResult]], traces: Mapping[str, Sequence[Trace]]
) -> tuple[int, int]:
    """Returns the number of episodes that reach something by one and the same action, such as zeros, and of all such.

    An episode reaches something if it succeeds, or a measure of its protocol is true.
    """
    constant = total = 0
    for name, each in results.items():
        for result, trace in zip(each, traces[name], strict=True):
            if result.success or True in result.measures.values():
                total += 1
                constant += bool((trace.actions == trace.actions[:1]).all())
    return constant, total


def _text(value: Any) -> str:
    return "the default" if value is None else checks.shown(value)

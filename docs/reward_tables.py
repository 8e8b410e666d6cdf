"""The tables of rewards and success on the page of the kitchen: `REWARD_TABLES`."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from entity_tables import markdown

_BENCHMARKS = Path(__file__).parent / "benchmarks"
_RESULTS, _FAILED = _BENCHMARKS / "kitchen_rewards.json", _BENCHMARKS / "failed_returns.json"


def reward_table() -> str:
    """Returns the table of what `kitchen_rewards.py` has measured."""
    header = (
        "task",
        "`original`: successes (steps)",
        "`strict`: successes (steps)",
        "greatest fall",
        "greatest potential before completion",
        "`dense`: expert, standing still",
        "`dense_gain`: expert, standing still",
    )
    return markdown(header, map(_row, json.loads(_RESULTS.read_text(encoding="utf-8"))))


def _row(result: dict[str, Any]) -> tuple[str, ...]:
    successes = (
        f"{result[f'{name}_success']} of {result['episodes']} ({result[f'{name}_steps']:.0f})"
        for name in ("original", "strict")
    )
    return (
        f"`{result['task']}`",
        *successes,
        f"{result['greatest_fall']:.3f}",
        f"{result['greatest_potential']:.2f}",
        f"{result['dense_return']:.0f}, {result['dense_waiting']:.1f}",
        f"{result['gain_return']:.3f}, {result['gain_waiting']:.3f}",
    )


def failed_table() -> str:
    """Returns the table of the greatest returns without success that `failed_returns.py` has found."""
    expert = {row["task"]: row for row in json.loads(_RESULTS.read_text(encoding="utf-8"))}
    found = {(row["task"], row["reward"]): row for row in json.loads(_FAILED.read_text(encoding="utf-8"))}
    rows = []
    for task in dict.fromkeys(task for task, _ in found):
        dense, gain = found[task, "dense"], found[task, "dense_gain"]
        rows.append(
            (
                f"`{task}`",
                f"{dense['greatest_return']:.1f} of {dense['episodes']:,}",
                f"{expert[task]['dense_return']:.1f}",
                f"{gain['greatest_return']:.3f} of {gain['episodes']:,}",
                f"{expert[task]['gain_return']:.3f}",
            )
        )
    header = ("task", "`dense`: greatest, of failed episodes", "expert", "`dense_gain`: greatest, of failed", "expert")
    return markdown(header, rows)


REWARD_TABLES: dict[str, Callable[[], str]] = {"kitchen_rewards": reward_table, "failed_returns": failed_table}

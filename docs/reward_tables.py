"""The table of rewards and success on the page of the kitchen: `REWARD_TABLES`."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from entity_tables import markdown

_RESULTS = Path(__file__).parent / "benchmarks" / "kitchen_rewards.json"


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


REWARD_TABLES: dict[str, Callable[[], str]] = {"kitchen_rewards": reward_table}

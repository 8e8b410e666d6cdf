"""The tables of rewards and success on the page of the kitchen: `REWARD_TABLES`."""

from collections.abc import Callable
from typing import Any

from benchmark_results import read_results
from entity_tables import markdown

from kitchen_suite.tasks import DEFAULT_TASKS


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
    return markdown(header, map(_row, read_results("kitchen_rewards")))


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
    """Returns the table of failed episodes that `failed_returns.py` has measured, beside the expert's returns."""
    failed = {(row["task"], row["reward"]): row for row in read_results("failed_returns")}
    expert = {row["task"]: row for row in read_results("kitchen_rewards")}
    rows = [
        (
            f"`{task}`",
            *_failed_cells(failed[task, "dense"], expert[task]["dense_return"]),
            *_failed_cells(failed[task, "dense_gain"], expert[task]["gain_return"]),
        )
        for task in DEFAULT_TASKS
    ]
    measures = ("failed episodes", "their greatest return", "least return of the expert")
    return markdown(("task", *(f"`{reward}`: {name}" for reward in ("dense", "dense_gain") for name in measures)), rows)


def _failed_cells(failed: dict[str, Any], expert_return: float) -> tuple[str, ...]:
    greatest = failed["greatest_return"]
    return str(failed["episodes"]), "none" if greatest is None else f"{greatest:.3g}", f"{expert_return:.3g}"


REWARD_TABLES: dict[str, Callable[[], str]] = {"kitchen_rewards": reward_table, "failed_returns": failed_table}

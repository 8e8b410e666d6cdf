"""The tables of the page on training, from the results in docs/benchmarks/."""

from collections.abc import Callable, Iterable
from types import MappingProxyType
from typing import Any

from benchmark_results import RESULTS, read_results
from entity_tables import markdown
from evaluation_tables import rate

from kitchen_suite.tasks import DEFAULT_TASKS

_ONE = "random_1"

# Fractions of episodes with at least 1 to 7 tasks completed.
_RATES = tuple(f"p{number}" for number in range(1, 8))

# Networks that `docs/sequence_results.py` has measured.
_TRAINED_ON = {"single": "one task at a time", "sequences": "sequences"}


def _measures(row: dict[str, Any]) -> Iterable[str]:
    """Returns the cells of a run's seed, control steps and times."""
    return (str(row["seed"]), f"{row['steps']:,}", f"{row['minutes']:.1f}", f"{row['processor_minutes']:.1f}")


def task_table() -> str:
    """Returns the table of the runs of single tasks."""
    rows = [
        (f"`{row['task']}`", *_measures(row), f"{row['success'][0]} of {row['episodes']}")
        for row in read_results("training")
        if row["task"] != _ONE
    ]
    return markdown(("task", "seed", "control steps", "minutes", "processor minutes", "successes"), rows)


def network_table() -> str:
    """Returns the table of the runs of one network for the seven tasks; a row for each run, a column for each task."""
    rows = [(*_measures(row), *row["success"]) for row in read_results("training") if row["task"] == _ONE]
    return markdown(("seed", "control steps", "minutes", "processor minutes", *DEFAULT_TASKS), rows)


def sequence_table() -> str:
    """Returns the table of sequences of tasks, by what a network was trained on, from `docs/sequence_results.py`."""
    paths = [path for policy in _TRAINED_ON for path in sorted(RESULTS.glob(f"sequences/{policy}_*.json"))]
    rows = []
    for path in paths:
        result, (policy, length) = read_results(f"sequences/{path.stem}"), path.stem.split("_")
        rates = [rate(result, name) for name in _RATES]
        rows.append((_TRAINED_ON[policy], length, str(result["num_episodes"]), *rates, f"{result['mean_tasks']:.2f}"))
    return markdown(("trained on", "tasks asked", "episodes", *_RATES, "mean tasks"), rows)


def speed_table() -> str:
    """Returns the table of the speed of training, and what takes its time, from `docs/training_speed.py`."""
    rows = [
        (
            row["settings"],
            row["threads"],
            f"{row['steps_per_second']:,.0f}",
            f"{row['environments']:.0%}",
            f"{row['update']:.0%}",
        )
        for row in read_results("training_speed")
    ]
    return markdown(("hyperparameters", "threads", "control steps per second", "environments", "update"), rows)


TRAINING_TABLES: MappingProxyType[str, Callable[[], str]] = MappingProxyType(
    {
        "training_tasks": task_table,
        "training_network": network_table,
        "training_sequences": sequence_table,
        "training_speed": speed_table,
    }
)

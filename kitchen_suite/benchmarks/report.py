"""Results of `kitchen-benchmark` as tables, in plain text and in markdown."""

import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import metadata
from typing import Any

Table = list[Sequence[str]]

_PACKAGES = ("mujoco", "dm_control", "numpy", "gymnasium", "gymnasium-robotics", "envpool")


def versions() -> dict[str, str]:
    """Versions of what decides the speed, of packages that are installed."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def speed_tables(results: Mapping[str, Any]) -> list[Table]:
    """Ratios of the contenders, the further ones, and what stands above physics."""
    rows = [
        (name, *_spread(row), f"{row['ratio_per_thread']:.2f}", f"{row['steps_per_second']:.0f}")
        for name, row in results["results"].items()
    ]
    above = [(name, f"{cost:.1f}") for name, cost in results["overhead"].items()]
    compared = [(name, *_spread(row)) for name, row in results["comparisons"].items()]
    return [
        [("ratio to bare mj_step", "median", "least", "greatest", "a thread", "steps/s"), *rows],
        [("further ratios", "median", "least", "greatest"), *compared],
        [("above physics, without visuals", "us a control step"), *above],
    ]


def scaling_tables(results: Mapping[str, Any]) -> list[Table]:
    """Throughput by number of environments and threads, and memory."""
    header = ("environments", "threads", "steps/s", "MiB an environment")
    rows = [
        (
            f"{row['builder']}, {row['environments']}",
            str(row["threads"]),
            f"{row['steps_per_second']:.0f}",
            "" if row["memory"] is None else f"{row['memory']:.2f}",
        )
        for row in results["results"]
    ]
    return [[header, *rows]]


def soak_tables(results: Mapping[str, Any]) -> list[Table]:
    """Memory in the course of a long run."""
    rows = zip(results["results"]["control_steps"], results["results"]["memory"], strict=True)
    return [[("control steps", "MiB"), *((f"{steps:.0f}", f"{memory:.1f}") for steps, memory in rows)]]


# What makes tables of the results of each kind of measurement.
TABLES: Mapping[str, Callable[[Mapping[str, Any]], list[Table]]] = {
    "speed": speed_tables,
    "scaling": scaling_tables,
    "soak": soak_tables,
}


def plain(results: Mapping[str, Any]) -> str:
    """All tables and the versions, in columns."""
    tables = TABLES[results["measure"]](results)
    return "\n\n".join([*map(_columns, tables), _described(results)])


def markdown(results: Mapping[str, Any]) -> str:
    """All tables and the versions, for a page."""
    tables = TABLES[results["measure"]](results)
    return "\n".join([*map(_piped, tables), f"{_described(results)}.\n"])


def _spread(row: Mapping[str, float]) -> tuple[str, str, str]:
    return f"{row['ratio']:.2f}", f"{row['least']:.2f}", f"{row['greatest']:.2f}"


def _columns(table: Table) -> str:
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join(
        "  ".join(
            [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        )
        for row in table
    )


def _piped(table: Table) -> str:
    lines: Iterable[Sequence[str]] = [table[0], ["---", *["--:"] * (len(table[0]) - 1)], *table[1:]]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _described(results: Mapping[str, Any]) -> str:
    return f"`{results['command']}`: " + ", ".join(f"{name} {version}" for name, version in results["versions"].items())

"""Tables of benchmarks, in plain text and in Markdown."""

import argparse
import json
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tabulate import tabulate

from kitchen_suite import installation
from kitchen_suite.versions import installed_versions

# Packages that are measured beside the suite.
_OTHERS = ("envpool",)

# Header and rows.
Table = tuple[Sequence[str], Sequence[Sequence[str]]]


def speed_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns tables of the cases' ratios to bare MuJoCo, of the named ratios, and of the overhead beyond physics."""
    cases = []
    for name, row in results["results"].items():
        cases.append((name, *_statistics(row), f"{row['ratio_per_thread']:.2f}", f"{row['steps_per_second']:.0f}"))
    ratios = [(name, *_statistics(row)) for name, row in results["ratios"].items()]
    overhead = [(name, f"{microseconds:.1f}") for name, microseconds in results["overhead"].items()]
    return [
        (("ratio to bare mj_step", "median", "min", "max", "per thread", "steps/s"), cases),
        (("other ratios", "median", "min", "max"), ratios),
        (("overhead beyond physics, without visuals", "us per control step"), overhead),
    ]


def _statistics(row: Mapping[str, float]) -> list[str]:
    return [f"{row[key]:.2f}" for key in ("ratio", "min", "max")]


def scaling_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns a table of throughput by number of environments and threads, beside MuJoCo's own batch, and of memory."""
    rows = []
    for row in results["results"]:
        rows.append(
            (
                f"{row['vector_env']}, {row['num_envs']}",
                str(row["num_threads"]),
                f"{row['steps_per_second']:.0f}",
                f"{row['steps_per_second'] / row['num_threads']:.0f}",
                _number(row["efficiency"]),
                _number(row["bare_efficiency"]),
                _number(row["of_bare"]),
                f"{row['reset']:.2f}",
                _number(row["memory"]),
            )
        )
    header = (
        "environments",
        "threads",
        "steps/s",
        "per thread",
        "efficiency",
        "that of MuJoCo's batch",
        "steps/s relative to it",
        "reset [control steps]",
        "MiB each",
    )
    return [(header, rows)]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def rendering_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns tables of frames per second, of the parts of a frame's time, and of what that time is spent on."""
    by_size = {f"{each['size']} x {each['size']}": each["renderers"] for each in results["results"]}
    rows = [(f"{name}, {size}", row) for size, renderers in by_size.items() for name, row in renderers.items()]
    size, renderers = next(iter(by_size.items()))
    first = next(iter(renderers))
    frames = [
        (name, f"{row['ratio']:.1f}", f"{1 / row['times']['frame']:.1f}", str(row["num_faces"])) for name, row in rows
    ]
    parts = [(name, *map(_milliseconds, row["times"].values())) for name, row in rows]
    contents = []
    for content in renderers[first]["contents"]:
        contents.append((content, *(_milliseconds(row["contents"][content]) for row in renderers.values())))
    return [
        (("frames", f"ratio to {first}", "frames/s", "faces of meshes"), frames),
        (("parts of a frame [ms]", *rows[0][1]["times"]), parts),
        ((f"saved where left out, {size} [ms]", *renderers), contents),
    ]


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


TABLES: Mapping[str, Callable[[Mapping[str, Any]], list[Table]]] = {
    "speed": speed_tables,
    "scaling": scaling_tables,
    "rendering": rendering_tables,
}


def plain(results: Mapping[str, Any]) -> str:
    """Returns all tables for a terminal, with the command, the machine and the versions."""
    return _document(results, "simple")


def markdown(results: Mapping[str, Any]) -> str:
    """Returns all tables in Markdown, with the command, the machine and the versions."""
    return f"{_document(results, 'pipe')}.\n"


def _document(results: Mapping[str, Any], style: str) -> str:
    tables = TABLES[results["measure"]](results)
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    source = f"`{results['command']}`: {_machine(results)}{versions}"
    return "\n\n".join([*(_table(*each, style) for each in tables), source])


def _machine(results: Mapping[str, Any]) -> str:
    """Returns the machine of results that name it, and how busy it was with other programs."""
    machine = results.get("machine")
    if machine is None:
        return ""
    before = machine["load_before"]
    load = "" if before is None else f" (load by other programs before: {before:.1f})"
    device = f"{results['device']}, " if "device" in results else ""
    return f"{device}{machine['processors']} processors {machine['processor']}{load}, "


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], style: str) -> str:
    """Returns a table in one of tabulate's formats; the first column is left-aligned, the others right-aligned."""
    alignment = ["left", *["right"] * (len(header) - 1)]
    return tabulate(rows, header, tablefmt=style, colalign=alignment, disable_numparse=True)


def print_results(
    parser: argparse.ArgumentParser, options: argparse.Namespace, measure: str, results: Mapping[str, Any]
) -> None:
    """Prints the results of a benchmark with its command line and the versions, as tables or as JSON."""
    named = {"measure": measure, "command": command_line(parser, options), "versions": versions(), **results}
    print(json.dumps(named) if options.json else plain(named))


def command_line(parser: argparse.ArgumentParser, options: argparse.Namespace) -> str:
    """Returns the command of some options, with those that differ from their defaults but for --json."""
    flags = []
    for name, value in vars(options).items():
        if name != "json" and value != parser.get_default(name):
            text = ",".join(map(str, value)) if isinstance(value, tuple) else value
            flags.append(f"--{name}" if value is True else f"--{name}={text}")
    return " ".join([f"python docs/experiments/{Path(sys.argv[0]).name}", *flags])


def versions() -> dict[str, str]:
    """Returns the versions that speed depends on: of Python, the suite, its packages, and others where installed."""
    others = {name: installation.version_of(name) for name in _OTHERS}
    found = {name: version for name, version in others.items() if version}
    return {"python": platform.python_version(), **installed_versions(), **found}

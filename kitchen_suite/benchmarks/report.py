"""Tables of benchmark results, in plain text and in markdown."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tabulate import tabulate


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of strings; the first column is left-aligned, the others right-aligned."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def format(self, style: str) -> str:
        """Returns the table's text in one of tabulate's formats."""
        alignment = ["left", *["right"] * (len(self.header) - 1)]
        return tabulate(self.rows, self.header, tablefmt=style, colalign=alignment, disable_numparse=True)


def speed_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns tables of the cases' ratios to bare MuJoCo, of the named ratios, and of the overhead beyond physics."""
    cases = [
        (name, *_statistics(row), f"{row['ratio_per_thread']:.2f}", f"{row['steps_per_second']:.0f}")
        for name, row in results["results"].items()
    ]
    ratios = [(name, *_statistics(row)) for name, row in results["ratios"].items()]
    overhead = [(name, f"{microseconds:.1f}") for name, microseconds in results["overhead"].items()]
    return [
        Table(("ratio to bare mj_step", "median", "min", "max", "per thread", "steps/s"), cases),
        Table(("other ratios", "median", "min", "max"), ratios),
        Table(("overhead beyond physics, without visuals", "us per control step"), overhead),
    ]


def _statistics(row: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(f"{row[key]:.2f}" for key in ("ratio", "min", "max"))


def scaling_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns a table of throughput and memory by number of environments and threads."""
    rows = [
        (
            f"{row['vector_env']}, {row['num_envs']}",
            str(row["num_threads"]),
            f"{row['steps_per_second']:.0f}",
            "" if row["memory"] is None else f"{row['memory']:.2f}",
        )
        for row in results["results"]
    ]
    return [Table(("environments", "threads", "steps/s", "MiB per environment"), rows)]


def soak_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns a table of memory in the course of a long run."""
    samples = zip(results["results"]["num_steps"], results["results"]["memory"], strict=True)
    return [Table(("control steps", "MiB"), [(f"{steps:.0f}", f"{memory:.1f}") for steps, memory in samples])]


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
    contents = [
        (content, *(_milliseconds(row["contents"][content]) for row in renderers.values()))
        for content in renderers[first]["contents"]
    ]
    return [
        Table(("frames", f"ratio to {first}", "frames/s", "faces of meshes"), frames),
        Table(("parts of a frame [ms]", *rows[0][1]["times"]), parts),
        Table((f"saved where left out, {size} [ms]", *renderers), contents),
    ]


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


# By measure.
TABLES: Mapping[str, Callable[[Mapping[str, Any]], list[Table]]] = {
    "speed": speed_tables,
    "scaling": scaling_tables,
    "soak": soak_tables,
    "rendering": rendering_tables,
}


def plain(results: Mapping[str, Any]) -> str:
    """Returns all tables for a terminal, with the command and the versions."""
    return _document(results, "simple")


def markdown(results: Mapping[str, Any]) -> str:
    """Returns all tables in markdown, with the command and the versions."""
    return f"{_document(results, 'pipe')}.\n"


def _document(results: Mapping[str, Any], style: str) -> str:
    tables = TABLES[results["measure"]](results)
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return "\n\n".join([*(table.format(style) for table in tables), f"`{results['command']}`: {versions}"])

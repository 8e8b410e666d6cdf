"""Text of the commands: tables, statistics of episodes row by row and in sum, a progress bar."""

import re
import statistics
import sys
import textwrap
from collections.abc import Mapping, Sequence

from tabulate import tabulate
from tqdm import tqdm

from kitchen_suite import checks
from kitchen_suite.episodes.episode import Summary

# Characters in a line that a command prints.
WIDTH = 100

# Formats of tables, with tabulate's names of them; LaTeX needs the package booktabs.
TABLE_FORMATS: Mapping[str, str] = {"text": "simple", "markdown": "pipe", "latex": "latex_booktabs"}

# Characters with a meaning in Markdown that names and numbers of reports do without; `_` has none within a word.
_MARKDOWN = re.compile(r"[\\|<>&`*]|(?<=\])\(")

_GAP = "  "
_UNBROKEN = "\N{NO-BREAK SPACE}"

# Value of a metric of `tasks.records.Metrics`.
_Metric = bool | float | dict[str, int]


class Report:
    """Collects the statistics of episodes; each is a row, all together a summary."""

    def __init__(self, *, last_seed: int) -> None:
        """Starts an empty report; the greatest seed to come decides the width of its column."""
        self._widths = {"seed": len(str(last_seed)), "return": 8}
        self._episodes: list[Summary] = []

    @property
    def count(self) -> int:
        return len(self._episodes)

    def add(self, stats: Summary, index: int | None = None) -> str:
        """Returns the row of an episode, by default the next one; the first time with the heading above it."""
        cells = _cells(len(self._episodes) if index is None else index, stats)
        heading = "" if self._episodes else self._row({name: name for name in cells}) + "\n"
        self._episodes.append(stats)
        return heading + self._row(cells)

    def summary(self) -> str:
        """Returns the means over all episodes, one a line."""
        episodes = self._episodes
        if not episodes:
            return "no episode was finished"
        seconds = sum(stats.seconds for stats in episodes)
        steps = sum(stats.steps for stats in episodes if stats.seconds)  # Those of kitchen-convert took no time.
        lines = {
            "episodes": str(len(episodes)),
            "mean return": _number(statistics.fmean(stats.total_reward for stats in episodes)),
            **dict(_mean(name, [stats.metrics[name] for stats in episodes]) for name in episodes[0].metrics),
            **({"steps per second": f"{steps / seconds:.0f}"} if seconds else {}),
        }
        return tabulate(lines.items(), tablefmt="plain", disable_numparse=True)

    def _row(self, cells: dict[str, str]) -> str:
        """Aligns cells to the right below their names; the last one begins below its name, and may take many lines."""
        *names, last = cells
        widths = (max(len(name), self._widths.get(name, 0)) for name in names)
        start = "".join(f"{cells[name]:>{width}}{_GAP}" for name, width in zip(names, widths, strict=True))
        # Never so narrow that a long seed would leave no room; and names stay in one line.
        width = max(WIDTH, len(start) + max(len(last), 30))
        wrapper = textwrap.TextWrapper(
            width, initial_indent=start, subsequent_indent=" " * len(start), break_long_words=False
        )
        return wrapper.fill(cells[last]).replace(_UNBROKEN, " ")


class EpisodeBar(tqdm):
    """A progress bar, where stderr is a terminal, that counts episodes and shows how many of them succeeded."""

    def __init__(self, total: int, found: int = 0, successes: int = 0) -> None:
        """Shows the bar; of the total, `found` episodes were there before."""
        super().__init__(total=total, initial=found, unit="episode", disable=None, leave=False)
        self._successes = successes

    def count(self, success: bool) -> None:
        self._successes += success
        self.set_postfix_str(f"success {self._successes / (self.n + 1):.0%}", refresh=False)
        self.update()


def table(header: Sequence[str], rows: Sequence[Sequence[str]], table_format: str = "text") -> str:
    """Returns a table in one of `TABLE_FORMATS`; the first column is left-aligned, the others right-aligned."""
    alignment = ["left", *["right"] * (len(header) - 1)]
    style = TABLE_FORMATS[checks.choice(table_format, TABLE_FORMATS, "table_format")]
    if table_format == "markdown":
        header, *rows = ([in_markdown(cell) for cell in row] for row in (header, *rows))
    return tabulate(rows, header, tablefmt=style, colalign=alignment, disable_numparse=True)


def paragraph(text: str, table_format: str = "text") -> str:
    """Returns a text that stands between tables of one of `TABLE_FORMATS`; in LaTeX it is a comment."""
    if table_format == "latex":
        return textwrap.indent(checks.printable(text), "% ")
    return in_markdown(text) if table_format == "markdown" else text


def in_markdown(text: str) -> str:
    """Returns a text that Markdown shows as it is: without HTML, links, further cells of a table, or emphasis."""
    return _MARKDOWN.sub(lambda found: f"&#{ord(found[0])};", text)


def counted(count: int) -> str:
    """Returns a number of episodes as a text, such as `5 episodes`."""
    return f"{count} episode" + ("" if count == 1 else "s")


def print_line(text: str) -> None:
    """Prints above a progress bar and flushes: an episode may take long, and the reader may be a pipe.

    Names of files, policies and tasks may be those of strangers: control characters are printed by their codes.
    """
    tqdm.write(checks.printable(text))
    sys.stdout.flush()


def _cells(index: int, stats: Summary) -> dict[str, str]:
    """Returns the cells of a row by column; the one that takes most room is last."""
    metrics = sorted(stats.metrics.items(), key=lambda item: isinstance(item[1], dict))
    return {
        "episode": str(index),
        "seed": str(stats.seed),
        "return": _number(stats.total_reward),
        "steps": str(stats.steps),
        "seconds": f"{stats.seconds:7.2f}",
        **{
            name.replace("_", " ") + (" (at control step)" if isinstance(value, dict) else ""): _text(name, value)
            for name, value in metrics
        },
    }


def _text(name: str, value: _Metric) -> str:
    if isinstance(value, dict):
        events = (f"{event} ({step})".replace(" ", _UNBROKEN) for event, step in value.items())
        return ", ".join(events) or "none"
    text = _number(value) if not isinstance(value, bool) else "yes" if value else "no"
    return text.rjust(len(name))


def _mean(name: str, values: list[_Metric]) -> tuple[str, str]:
    """Returns name and value of a line of the summary: a rate of verdicts, a mean of measures or of counted events."""
    name = name.replace("_", " ")
    measures = [len(value) if isinstance(value, dict) else value for value in values]
    mean = statistics.fmean(measures)
    if isinstance(values[0], bool):
        return f"{name} rate", f"{mean:.0%} ({sum(measures)} of {len(measures)})"
    return f"mean {name}", _number(mean)


def _number(value: float) -> str:
    return f"{value:.5g}"

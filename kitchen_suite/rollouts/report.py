"""A table of episodes as plain text, row by row, and a summary."""

import statistics
import textwrap

from kitchen_suite.rollouts.episode import EpisodeStats, Result

WIDTH = 100  # Characters in a line.
_GAP = "  "
_UNBROKEN = "\N{NO-BREAK SPACE}"


class Report:
    """Takes the outcomes of episodes one by one; each makes a row, all together a summary."""

    def __init__(self, *, last_seed: int) -> None:
        """Starts an empty report.

        Args:
          last_seed: the greatest seed to come, which decides how wide its column is.
        """
        self._widths = {"seed": len(str(last_seed)), "return": 8}
        self._outcomes: list[EpisodeStats] = []

    @property
    def count(self) -> int:
        """Number of episodes so far."""
        return len(self._outcomes)

    @property
    def successes(self) -> int:
        """Number of those that succeeded."""
        return sum(outcome.results["success"] is True for outcome in self._outcomes)

    def add(self, outcome: EpisodeStats, index: int | None = None) -> str:
        """Returns the episode's row; the first time with the heading above it.

        Args:
          outcome: what came of it.
          index: its number; by default the next one.
        """
        cells = _cells(len(self._outcomes) if index is None else index, outcome)
        heading = "" if self._outcomes else self._row({name: name for name in cells}) + "\n"
        self._outcomes.append(outcome)
        return heading + self._row(cells)

    def summary(self) -> str:
        """Returns the means over all episodes, one a line."""
        if not self._outcomes:
            return "no episode was finished"
        speed = sum(outcome.steps for outcome in self._outcomes) / sum(outcome.seconds for outcome in self._outcomes)
        lines = {
            "episodes": str(len(self._outcomes)),
            "mean return": _number(statistics.fmean(outcome.total_reward for outcome in self._outcomes)),
            **dict(_mean(name, [outcome.results[name] for outcome in self._outcomes]) for name in self._results),
            "steps per second": f"{speed:.0f}",
        }
        width = max(map(len, lines))
        return "\n".join(f"{name:<{width}}{_GAP}{value}" for name, value in lines.items())

    @property
    def _results(self) -> list[str]:
        return list(self._outcomes[0].results)

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


def _cells(index: int, outcome: EpisodeStats) -> dict[str, str]:
    """What stands in a row, by column; what takes most room comes last."""
    results = sorted(outcome.results.items(), key=lambda item: isinstance(item[1], dict))
    return {
        "episode": str(index),
        "seed": str(outcome.seed),
        "return": _number(outcome.total_reward),
        "steps": str(outcome.steps),
        "seconds": f"{outcome.seconds:7.2f}",
        **{_title(name, value): _text(name, value) for name, value in results},
    }


def _title(name: str, value: Result) -> str:
    return name.replace("_", " ") + (" (at control step)" if isinstance(value, dict) else "")


def _text(name: str, value: Result) -> str:
    if isinstance(value, dict):
        events = (f"{what} ({step})".replace(" ", _UNBROKEN) for what, step in value.items())
        return ", ".join(events) or "none"
    text = _number(value) if not isinstance(value, bool) else "yes" if value else "no"
    return text.rjust(len(name))


def _mean(name: str, values: list[Result]) -> tuple[str, str]:
    """Name and value of a line of the summary: a rate of verdicts, a mean of measures, a mean count of events."""
    name = name.replace("_", " ")
    measures = [len(value) if isinstance(value, dict) else value for value in values]
    mean = statistics.fmean(measures)
    if isinstance(values[0], bool):
        return f"{name} rate", f"{mean:.0%} ({sum(measures)} of {len(measures)})"
    return f"mean {name}", _number(mean)


def _number(value: float) -> str:
    return f"{value:.5g}"

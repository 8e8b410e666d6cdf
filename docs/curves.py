"""Draws curves of training runs, one line a run, from what TensorBoard reads.

python docs/curves.py OUT.png LABEL=RUN_FOLDER ...

A run's folder is that of kitchen-train or of one of its seeds; seeds that were given up are drawn before the one that
followed them. Rate of success and mean progress of the evaluations stand over million control steps, and below over
minutes of training.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Colours of Okabe and Ito, which people with colour-blindness can tell apart; the yellow one is too pale for lines.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
# Beyond the colours, lines differ by their dashes, too.
DASHES = ("-", "--", ":", "-.")
MEASURES = {"success": "episodes that succeed [%]", "progress": "mean opening [m], or tasks completed"}
TIMES = {"steps": "control steps [million]", "minutes": "time of training [min]"}

_TAGS = ("time/minutes", "evaluation/success", "evaluation/progress")


class Curve(NamedTuple):
    """Evaluations `(n,)` of a run: their times, and what they came to."""

    steps: NDArray[np.float64]
    minutes: NDArray[np.float64]
    success: NDArray[np.float64]
    progress: NDArray[np.float64]


def read(folder: Path) -> Curve:
    """Reads a run's curve; success in percent, steps in millions.

    Raises:
      OSError: there is none.
    """
    seeds = sorted(folder.glob("seed_*"), key=lambda path: int(path.name.removeprefix("seed_")))
    attempts, start = [], np.zeros(len(Curve._fields))
    for seed in seeds or [folder]:
        attempts.append(_read_attempt(seed) + start)
        start = attempts[-1][-1] * [name in TIMES for name in Curve._fields]
    return Curve(*np.concatenate(attempts).T)


def _read_attempt(folder: Path) -> NDArray[np.float64]:
    """Evaluations `(n, 4)` of one seed, with the columns of `Curve`; raises what `read` does."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    # By default it keeps a sample of the values.
    events = EventAccumulator(str(folder), size_guidance={"scalars": 0}).Reload()
    if not set(_TAGS) <= set(events.Tags()["scalars"]):
        raise OSError(f"{folder} holds no curves of kitchen-train")
    values = [{event.step: event.value for event in events.Scalars(tag)} for tag in _TAGS]
    # One that is being written may lack its last numbers.
    steps = sorted(set.intersection(*map(set, values)))
    minutes, success, progress = (np.array([column[step] for step in steps]) for column in values)
    return np.stack([np.array(steps) / 1e6, minutes, 100 * success, progress], axis=1)


def draw(curves: dict[str, Curve], out: Path) -> None:
    """Draws curves by their labels into a picture."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(len(TIMES), len(MEASURES), figsize=(10, 7), sharey="col", layout="constrained")
    for row, (time, time_title) in zip(axes, TIMES.items(), strict=True):
        for axis, (measure, title) in zip(row, MEASURES.items(), strict=True):
            for index, (label, curve) in enumerate(curves.items()):
                axis.plot(getattr(curve, time), getattr(curve, measure), label=label, **_style(index))
            _finish(axis, time_title, title)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=min(len(curves), 5))
    figure.savefig(out, dpi=150)
    pyplot.close(figure)


def _style(index: int) -> dict[str, Any]:
    dashes = DASHES[index // len(COLOURS) % len(DASHES)]
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": dashes, "linewidth": 1.8}


def _finish(axis: "Axes", time: str, measure: str) -> None:
    axis.set(xlabel=time, ylabel=measure, xlim=(0, None), ylim=(0, 103 if "%" in measure else None))
    axis.grid(alpha=0.3)
    axis.spines[["top", "right"]].set_visible(False)


def main(arguments: Sequence[str]) -> int:
    """Runs the command; returns the exit status."""
    out, *runs = arguments or [""]
    pairs = [run.partition("=")[::2] for run in runs]
    if Path(out).suffix != ".png" or not pairs or not all(label and folder for label, folder in pairs):
        print(__doc__, file=sys.stderr)
        return 2
    try:
        draw({label: read(Path(folder)) for label, folder in pairs}, Path(out))
    except OSError as error:
        print(f"curves.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

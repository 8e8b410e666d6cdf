"""Draws the curves of training runs from their TensorBoard files, one line for each run.

python docs/scripts/curves.py OUT.png LABEL=RUN_FOLDER ...

Runs with the same label, such as the seeds of a task, have lines of the same style.

A run's folder is the output folder of kitchen-train, or the folder of one of its seeds. Where a seed was given up, the
curve continues with the next one. The panels show success rate and mean progress of the evaluations, above over million
control steps, below over minutes of training.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Colours of Okabe and Ito, which colour-blind people can distinguish; without yellow, which is too pale for lines.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
# When all colours are used, lines differ by their dashes.
DASHES = ("-", "--", ":", "-.")
METRICS = {"success": "episodes that succeed [%]", "progress": ""}
# What the progress is, by domain.
PROGRESS = {
    "kitchen": "mean tasks completed",
    "open_cabinet": "mean opening [m]",
    "microwave_table": "mean opening, as a share of the goal",
}
TIMES = {"steps": "control steps [million]", "minutes": "time of training [min]"}

# Characters of a legend as wide as the figure.
LEGEND_WIDTH = 110

_TAGS = ("time/minutes", "evaluation/success", "evaluation/progress")


class Curve(NamedTuple):
    """Evaluations of a run.

    Attributes:
      steps: `(n,)`, control steps before the evaluation [million].
      minutes: `(n,)`, time of training before it [min].
      success: `(n,)`, success rate [%].
      progress: `(n,)`, mean opening [m], or mean number of completed tasks.
    """

    steps: NDArray[np.float64]
    minutes: NDArray[np.float64]
    success: NDArray[np.float64]
    progress: NDArray[np.float64]


def read(folder: Path) -> Curve:
    """Reads the curve of a run.

    Raises:
      OSError: the folder holds none.
    """
    seeds = sorted(folder.glob("seed_*"), key=lambda path: int(path.name.removeprefix("seed_")))
    parts, start = [], np.zeros(len(Curve._fields))
    for seed in seeds or [folder]:
        parts.append(_read_seed(seed) + start)
        # Steps and minutes of a seed follow those of the seed before it.
        start = parts[-1][-1] * [name in TIMES for name in Curve._fields]
    return Curve(*np.concatenate(parts).T)


def _read_seed(folder: Path) -> NDArray[np.float64]:
    """Returns the evaluations `(n, 4)` of one seed, with the columns of `Curve`.

    Raises:
      OSError: the folder holds none.
    """
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    # By default, it keeps a sample of the values; 0 keeps all.
    events = EventAccumulator(str(folder), size_guidance={"scalars": 0}).Reload()
    if not set(_TAGS) <= set(events.Tags()["scalars"]):
        raise OSError(f"{folder} holds no curves of kitchen-train")
    values = [{event.step: event.value for event in events.Scalars(tag)} for tag in _TAGS]
    # An evaluation that is being written may lack some of its values.
    steps = sorted(set.intersection(*map(set, values)))
    minutes, success, progress = (np.array([column[step] for step in steps]) for column in values)
    return np.stack([np.array(steps) / 1e6, minutes, 100 * success, progress], axis=1)


def progress_label(folders: Sequence[Path]) -> str:
    """Returns what the progress of runs is, by the domains that their folders name.

    Raises:
      OSError: a folder is not of a run, or the runs are of domains whose progress differs.
    """
    descriptions = [folder / "training.json" for folder in folders]
    texts = [(each if each.exists() else each.parent.parent / each.name).read_text("utf-8") for each in descriptions]
    labels = {PROGRESS.get(name, f"mean progress in {name}") for name in (json.loads(t)["domain_name"] for t in texts)}
    if len(labels) > 1:
        raise OSError(f"runs with different progress cannot share a plot: {', '.join(sorted(labels))}")
    return labels.pop()


def draw(curves: Sequence[tuple[str, Curve]], out: Path, progress: str) -> None:
    """Draws curves with their labels, and saves the figure; `progress` is the label of the progress."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    labels = [*dict.fromkeys(label for label, _ in curves)]
    figure, axes = pyplot.subplots(len(TIMES), len(METRICS), figsize=(10, 7), sharey="col", layout="constrained")
    for row, (time, time_title) in zip(axes, TIMES.items(), strict=True):
        for axis, (metric, title) in zip(row, (METRICS | {"progress": progress}).items(), strict=True):
            for label, curve in curves:
                axis.plot(getattr(curve, time), getattr(curve, metric), label=label, **_style(labels.index(label)))
            _format_axis(axis, time_title, title)
    lines, texts = axes[0, 0].get_legend_handles_labels()
    first = [lines[texts.index(label)] for label in labels]
    # Columns that fit the width: a line is as long as some eight characters.
    columns = LEGEND_WIDTH // (8 + max(map(len, labels)))
    figure.legend(first, labels, loc="outside upper center", ncols=max(1, min(len(labels), columns)))
    figure.savefig(out, dpi=150)
    pyplot.close(figure)


def _style(index: int) -> dict[str, Any]:
    """Returns the line style of the curve with a number."""
    dashes = DASHES[index // len(COLOURS) % len(DASHES)]
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": dashes, "linewidth": 1.8}


def _format_axis(axis: "Axes", time: str, metric: str) -> None:
    axis.set(xlabel=time, ylabel=metric, xlim=(0, None), ylim=(0, 103 if "%" in metric else None))
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
        folders = [Path(folder) for _, folder in pairs]
        curves = [(label, read(folder)) for (label, _), folder in zip(pairs, folders, strict=True)]
        draw(curves, Path(out), progress_label(folders))
    except OSError as error:
        print(f"curves.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

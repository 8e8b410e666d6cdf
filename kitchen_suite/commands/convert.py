"""The command `kitchen-convert`."""

from pathlib import Path

from absl.flags import DEFINE_string, FlagValues

from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command
from kitchen_suite.datasets.formats import FORMATS

DESCRIPTION = """Converts recordings to datasets of other programs, and human demonstrations to recordings.

  kitchen-convert runs --dataset=me/kitchen-v0               a Minari dataset of a recording
  kitchen-convert runs --format=lerobot --dataset=me/kitchen    or a LeRobot one, of a recording with
                                                             --obs_type=environment_state_agent_pos or images
  kitchen-convert runs --format=robomimic --dataset=me/kitchen --data_path=data    or a file for another program
  kitchen-convert kitchen_complete-v0.hdf5 --output=human    human demonstrations of the kitchen, in a file of D4RL
  kitchen-convert D4RL/kitchen/complete-v2 --output=human    human demonstrations in a Minari dataset

A dataset is whole or not there, and never replaces another one. Human demonstrations are taken to ask for the tasks
that they complete, by the suite's goals and thresholds, in that order. D4RL's have no velocities; policies that are
trained on them act on positions alone. Exit status: 0; 1 if reading or writing failed; 2 for a bad argument or data of
another layout, with one line on stderr; 130 if interrupted.
"""

_DEFAULT_FORMAT = "minari"


def define(values: FlagValues) -> None:
    """Defines the flags."""
    DEFINE_string("format", None, f"Format of the dataset: {', '.join(FORMATS)}; else {_DEFAULT_FORMAT}.", values)
    name = "Name of the dataset to make, such as me/kettle; in Minari it ends in a version, such as me/kettle-v0."
    DEFINE_string("dataset", None, name, values)
    flags.folder(values, "output", "Folder of the recording to make of demonstrations of people.")
    flags.path(values, "data_path", "Folder of the datasets; else Minari's or LeRobot's own.")
    flags.custom(values)


def run(given: FlagValues, source: str) -> None:
    """Makes a dataset of a recording, or a recording of demonstrations."""
    if (given.dataset is None) == (given.output is None):
        raise ValueError(
            "name either a dataset, OWNER/NAME, to make of a recording, or an output, the folder of a recording of "
            "demonstrations of people"
        )
    flags.import_custom(given)
    if given.dataset is not None:
        from kitchen_suite.datasets.convert import convert
        from kitchen_suite.episodes.report import print_line

        path = convert(source, given.format or _DEFAULT_FORMAT, given.dataset, given.data_path)
        print_line(f"dataset {given.dataset} of {source} in {path}")
    elif given.format is not None:
        raise ValueError(f"a recording has no format: leave out {given.format!r}")
    else:
        _import_human(source, given.output, given.data_path)


def _import_human(source: str, output: Path, data_path: Path | None) -> None:
    """Makes a recording of demonstrations, and prints their contents."""
    from tabulate import tabulate

    from kitchen_suite.datasets.human import import_human
    from kitchen_suite.episodes.report import print_line

    data = import_human(source, output, data_path)
    print_line(f"{data.episodes} episodes of {source} ({data.format}), {data.steps} control steps")
    print_line(f"goals of the data: {', '.join(sorted(data.goals)) or 'none of the suite'}\n")
    completions = tabulate(data.completions.items(), ("task", "episodes that complete it"), tablefmt="simple")
    counts = tabulate(sorted(data.counts.items()), ("tasks completed", "episodes"), tablefmt="simple")
    print_line(f"{completions}\n\n{counts}\n")
    if not data.has_velocities:
        print_line("velocities were not recorded: policies that are trained on these episodes act on positions alone")
    print_line(f"recording in {output}")


COMMAND = Command(
    name="kitchen-convert", description=DESCRIPTION, define=define, run=run, positional="recording or demonstrations"
)
main = COMMAND.main

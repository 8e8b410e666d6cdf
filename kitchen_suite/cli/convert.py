"""Converts human demonstrations of the kitchen by other programs to a recording that policies can be trained on.

  kitchen-convert kitchen_complete-v0.hdf5 --output=human    a file of D4RL: positions and goals, 60 numbers
  kitchen-convert D4RL/kitchen/complete-v2 --output=human    a Minari dataset, by its name or in a folder
  kitchen-train --domain_name=kitchen --task_name=random_4 --algorithm=bc --demonstrations=human --output=runs/human

Each episode is taken to ask for the tasks that it completes, by the suite's goals and thresholds, in the order of
completion. Observations of D4RL have no velocities; policies that are trained on them act on positions alone. Exit
status: 0; 1 if reading or writing failed; 2 for a bad argument or for data of another layout, with one line on stderr;
130 if interrupted.
"""

import sys

from kitchen_suite.cli.command import Command
from kitchen_suite.recordings.settings import ConvertSettings

COMMAND = Command(
    name="kitchen-convert",
    description=__doc__,
    settings=ConvertSettings,
    job="kitchen_suite.recordings.human_data:ConvertJob",
    positional="source",
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())

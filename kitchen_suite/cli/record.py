"""Records episodes of a task, many at once, each from its own seed. Needs no display.

  kitchen-record --output=runs                                a hundred episodes of random actions in the kitchen
  kitchen-record --output=runs --task_name=kettle --seed=7    another task, other seeds
  kitchen-record --output=runs --dataset=me/kitchen-v0        also makes a Minari dataset of them
  kitchen-record --output=runs --format=lerobot --dataset=me/kitchen       or a LeRobot dataset, see docs/lerobot.md
  kitchen-record --output=runs --preset=random_order          demonstrations: four tasks in an order drawn at each reset
  kitchen-record --output=runs --num_episodes=1000            completes the recording that is in the folder
  kitchen-record --output=runs --workers=4                    plays on Ray, in four processes

Episode i of --seed=S has the seed S+i and does not depend on how many are played at once. Its file is written
atomically, so that an interrupt, even by kill -9, loses only the episodes in progress; the same command completes the
recording. A policy module:callable must be stateless, or be played with --num_envs=1. Exit status: 0; 1 if writing, the
physics or the workers failed; 2 for a bad argument or policy, with one line on stderr; 130 if interrupted.
"""

import sys

from kitchen_suite.cli.command import Command
from kitchen_suite.recordings.settings import RecordSettings

COMMAND = Command(
    name="kitchen-record",
    description=__doc__,
    settings=RecordSettings,
    job="kitchen_suite.recordings.record_job:RecordJob",
    renders=lambda settings: settings.observes_pictures,
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())

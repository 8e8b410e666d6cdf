"""Plays recorded actions again, and checks that rewards and completions are identical. Needs no display.

  kitchen-replay runs                                     ten episodes of a folder of kitchen-record or kitchen-rollout
  kitchen-replay me/kitchen-v0                            of a Minari or LeRobot dataset
  kitchen-replay runs --episodes=all                      all episodes
  kitchen-replay runs --episodes=0,5,7-9 --video=a.mp4    also films them
  kitchen-replay runs --web=runs.html                     also writes a page that shows them in 3-D
  kitchen-replay D4RL/kitchen/complete-v2                 of a dataset of FrankaKitchen-v1

Exit status: 0 if all are equal; 1 if not, or if writing or the physics failed; 2 for a bad argument, with one line on
stderr; 130 if interrupted.
"""

import sys

from kitchen_suite.cli.command import Command
from kitchen_suite.recordings.settings import ReplaySettings

COMMAND = Command(
    name="kitchen-replay",
    description=__doc__,
    settings=ReplaySettings,
    job="kitchen_suite.recordings.replay:ReplayJob",
    # A recording may hold pictures, which its replay renders again.
    renders=lambda settings: True if settings.video else None,
    positional="source",
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())

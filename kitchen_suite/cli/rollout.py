"""Plays episodes of a task with a policy, and reports the results. Needs no display.

  kitchen-rollout                                          three episodes of random actions in the kitchen
  kitchen-rollout --list                                   domains, tasks and cameras
  kitchen-rollout --task_name=kettle --output=episodes     also writes each episode to a file
  kitchen-rollout --num_episodes=1 --video=kitchen.mp4     also films it
  kitchen-rollout --policy=expert --web=kitchen.html       completes the task, and writes a page that shows it in 3-D
  kitchen-rollout --policy=my_module:act                   acts as your own function does
  kitchen-rollout --workers=4 --num_episodes=100           plays on Ray, in four processes

Your own policy is a callable that takes a dm_env.TimeStep and returns the action. Files are written atomically. Ctrl-C
keeps the finished episodes and the video until then. Exit status: 0; 1 if writing, the physics or the workers failed; 2
for a bad argument or policy, with one line on stderr; 130 if interrupted.
"""

import sys

from kitchen_suite.cli.command import Command
from kitchen_suite.rollouts.settings import RolloutSettings

COMMAND = Command(
    name="kitchen-rollout",
    description=__doc__,
    settings=RolloutSettings,
    job="kitchen_suite.rollouts.rollout_job:make_job",
    renders=lambda settings: (settings.video is not None or settings.observes_pictures) and not settings.list,
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())

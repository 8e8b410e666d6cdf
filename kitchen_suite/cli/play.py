"""Plays a trained policy, and films it.

  kitchen-play                                               opens the drawer; the video is kitchen-play.mp4
  kitchen-play --shipped=top_drawer                          with the policy trained on the original reward
  kitchen-play --list                                        lists the policies that come with the package
  kitchen-play --policy_file=runs/drawer/policy.npz          with a policy written by kitchen-train
  kitchen-play --num_episodes=100 --novideo                  counts successes alone; needs no GL library
  kitchen-play --web=drawer.html                             a page to look at in 3-D; needs no GL library

The last line says how many episodes succeeded. Exit status: 0; 1 if writing or the physics failed; 2 for a bad
argument or policy file, with one line on stderr; 130 if interrupted.
"""

import contextlib
import sys

from kitchen_suite.cli.command import Command
from kitchen_suite.rendering import gl
from kitchen_suite.rollouts.settings import PlaySettings


def _renders(settings: PlaySettings) -> bool:
    """Returns whether a video is made: one that is asked for, or the default one where it can be rendered."""
    if settings.list or settings.novideo:
        return False
    if settings.video or settings.web:
        return settings.video is not None
    with contextlib.suppress(OSError):
        gl.find_library()
        return True
    return False


COMMAND = Command(
    name="kitchen-play",
    description=__doc__,
    settings=PlaySettings,
    job="kitchen_suite.rollouts.play_job:make_job",
    renders=_renders,
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())

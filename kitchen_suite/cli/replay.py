"""Plays recorded actions again, and tells whether rewards and completions are the same. Needs no display.

  kitchen-replay runs                                     ten episodes of a folder of kitchen-record
  kitchen-replay me/kitchen-v0                            of a Minari dataset
  kitchen-replay runs --episodes=all                      all episodes
  kitchen-replay runs --episodes=0,5,7-9 --video=a.mp4    also films them
  kitchen-replay D4RL/kitchen/complete-v2                 of a dataset of FrankaKitchen-v1

Exit status: 0 if all are equal; 1 if not, or if writing or the physics failed; 2 for a bad argument, with one line on
stderr; 130 if interrupted.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from absl import flags

from kitchen_suite.cli import common
from kitchen_suite.cli.common import FAILURE, INTERRUPTED, USAGE
from kitchen_suite.recordings import minari_root
from kitchen_suite.rendering import gl

# All else is imported late: dm_control must not be before the flags have told whether a GL library is needed.
if TYPE_CHECKING:
    from kitchen_suite.recordings import replay_job

_NAME = "kitchen-replay"

# Flags of their own, not the global ones: the command can be called from other programs, any number of times.
_FLAGS = flags.FlagValues()

_EPISODES = flags.DEFINE_string(
    "episodes", None, "Which episodes: all, or numbers and ranges such as 0,5,7-9.", flag_values=_FLAGS
)
_NUM_EPISODES = flags.DEFINE_integer(
    "num_episodes",
    10,
    "Without --episodes: how many, spread from the first to the last.",
    lower_bound=1,
    flag_values=_FLAGS,
)
_DATA_PATH = flags.DEFINE_string(
    "data_path", None, "Folder of the Minari datasets. Default: Minari's own.", flag_values=_FLAGS
)
_VIDEO = flags.DEFINE_string(
    "video", None, "Video of the replay, an .mp4 in an existing folder; replaced if it is there.", flag_values=_FLAGS
)
_CAMERA = flags.DEFINE_string("camera", "overview", "Camera of the video, by name or number.", flag_values=_FLAGS)
_WIDTH = flags.DEFINE_integer("width", 640, "Width of the video in pixels.", lower_bound=2, flag_values=_FLAGS)
_HEIGHT = flags.DEFINE_integer("height", 480, "Height of the video in pixels.", lower_bound=2, flag_values=_FLAGS)
_HELP = flags.DEFINE_boolean("help", False, "Show this help, and exit.", short_name="h", flag_values=_FLAGS)

flags.register_validator("video", common.check_video, flag_values=_FLAGS)
for _name in ("width", "height"):
    flags.register_validator(_name, lambda pixels: pixels % 2 == 0, "must be even", flag_values=_FLAGS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Args:
      arguments: the command line without the program's name; by default that of this process.

    Returns:
      The exit status.
    """
    try:
        names = common.parse(_FLAGS, _NAME, sys.argv[1:] if arguments is None else arguments, most=1)
        if _HELP.value:
            print(common.describe(_FLAGS, __doc__))
            return 0
    except flags.Error as error:
        return common.fail(_NAME, error, USAGE)
    with minari_root.datasets_in(_DATA_PATH.value):
        try:
            job = _prepare(names)
        except KeyboardInterrupt:
            return common.fail(_NAME, "interrupted", INTERRUPTED)
        except (ImportError, OSError, TypeError, ValueError) as error:
            return common.fail(_NAME, error, USAGE)
        return _run(job)


def console_main() -> int:
    """Runs the command as a process of its own; returns the exit status."""
    return common.run_as_process(main)


def _prepare(names: Sequence[str]) -> "replay_job.ReplayJob":
    if not names:
        raise ValueError("name what to replay: a folder of kitchen-record, or a Minari dataset")
    gl.prepare(rendering=_VIDEO.value is not None)
    from kitchen_suite.recordings import replay_job

    settings = replay_job.Settings(
        name=names[0],
        episodes=_EPISODES.value,
        num_episodes=_NUM_EPISODES.value,
        video=Path(_VIDEO.value) if _VIDEO.value else None,
        camera=_CAMERA.value,
        width=_WIDTH.value,
        height=_HEIGHT.value,
    )
    return replay_job.ReplayJob(settings)


def _run(job: "replay_job.ReplayJob") -> int:
    from dm_control.rl.control import PhysicsError

    return common.perform(
        _NAME,
        lambda: 0 if job.run() else FAILURE,
        interrupted=lambda: f"interrupted after {job.finished} of {job.count} episodes",
        failures=(PhysicsError, OSError, ValueError),
    )


if __name__ == "__main__":
    sys.exit(console_main())

"""Plays a trained policy, and films it.

  kitchen-play                                               the drawer is opened; the video is kitchen-play.mp4
  kitchen-play --shipped=top_drawer_grasp                    by a policy that was paid for holding the handle
  kitchen-play --policy_file=runs/drawer/seed_0/policy.npz   what kitchen-train has written
  kitchen-play --num_episodes=100 --novideo                counts successes alone; needs no GL library

The last line says how many episodes succeeded. Exit status: 0; 1 if writing or the physics failed; 2 for a bad
argument or policy file, with one line on stderr; 130 if interrupted.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from absl import flags

from kitchen_suite.cli import common
from kitchen_suite.cli.common import INTERRUPTED, USAGE
from kitchen_suite.rendering import gl

# All else is imported late: dm_control must not be before the flags have told whether a GL library is needed.
if TYPE_CHECKING:
    from kitchen_suite.rollouts import rollout_job

_NAME = "kitchen-play"

# Flags of their own, not the global ones: the command can be called from other programs, any number of times.
_FLAGS = flags.FlagValues()

_SHIPPED = flags.DEFINE_string(
    "shipped", None, "Policy to play, one of those that come with the package. Default: top_drawer.", flag_values=_FLAGS
)
_POLICY_FILE = flags.DEFINE_string("policy_file", None, "File of a policy to play instead.", flag_values=_FLAGS)
_NUM_EPISODES = flags.DEFINE_integer("num_episodes", 10, "Number of episodes.", lower_bound=1, flag_values=_FLAGS)
_SEED = flags.DEFINE_integer(
    "seed", 0, "Seed of the first episode; each further one has the next.", lower_bound=0, flag_values=_FLAGS
)
_VIDEO = flags.DEFINE_boolean("video", True, "Film the first episodes.", flag_values=_FLAGS)
_VIDEO_FILE = flags.DEFINE_string(
    "video_file", "kitchen-play.mp4", "Where to; replaced if it is there.", flag_values=_FLAGS
)
_VIDEO_EPISODES = flags.DEFINE_integer(
    "video_episodes", 2, "How many of the episodes are filmed.", lower_bound=1, flag_values=_FLAGS
)
_CAMERA = flags.DEFINE_string("camera", "overview", "Camera of the video, by name or number.", flag_values=_FLAGS)
_HELP = flags.DEFINE_boolean("help", False, "Show this help, and exit.", short_name="h", flag_values=_FLAGS)

flags.register_validator("video_file", common.check_video, flag_values=_FLAGS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command.

    Args:
      arguments: the command line without the program's name; by default that of this process.

    Returns:
      The exit status.
    """
    try:
        common.parse(_FLAGS, _NAME, sys.argv[1:] if arguments is None else arguments)
        if _HELP.value:
            print(common.describe(_FLAGS, __doc__))
            return 0
        gl.prepare(rendering=_VIDEO.value)
        job = _prepare()
    except KeyboardInterrupt:
        return common.fail(_NAME, "interrupted", INTERRUPTED)
    except (flags.Error, ImportError, OSError, TypeError, ValueError) as error:
        return common.fail(_NAME, error, USAGE)
    return _run(job)


def console_main() -> int:
    """Runs the command as a process of its own; returns the exit status."""
    return common.run_as_process(main)


def _prepare() -> "rollout_job.RolloutJob":
    from kitchen_suite.policies.trained import shipped_as
    from kitchen_suite.rollouts import rollout_job

    if _SHIPPED.value and _POLICY_FILE.value:
        raise ValueError("--shipped and --policy_file both name a policy: give one of them")
    settings = rollout_job.settings_of_policy(
        Path(_POLICY_FILE.value) if _POLICY_FILE.value else shipped_as(_SHIPPED.value or "top_drawer"),
        num_episodes=_NUM_EPISODES.value,
        seed=_SEED.value,
        video=Path(_VIDEO_FILE.value) if _VIDEO.value else None,
        camera=_CAMERA.value,
        video_episodes=_VIDEO_EPISODES.value,
    )
    return rollout_job.RolloutJob(settings)


def _run(job: "rollout_job.RolloutJob") -> int:
    from dm_control.rl.control import PhysicsError

    from kitchen_suite.policies import PolicyError

    status = common.perform(
        _NAME,
        job.run,
        interrupted=lambda: f"interrupted after {job.finished} of {_NUM_EPISODES.value} episodes",
        failures=(PhysicsError, OSError),
        misuses=(PolicyError,),
    )
    if not status:
        if _VIDEO.value:
            print(f"video {_VIDEO_FILE.value}")
        print(f"success {job.successes}/{job.finished}")
    return status


if __name__ == "__main__":
    sys.exit(console_main())

"""Plays episodes of a task with a policy, and tells what came of them. Needs no display.

  kitchen-rollout                                          three episodes of random actions in the kitchen
  kitchen-rollout --list                                   domains, tasks and cameras
  kitchen-rollout --task_name=kettle --output=episodes     also writes each episode to a file
  kitchen-rollout --num_episodes=1 --video=kitchen.mp4     also films them
  kitchen-rollout --policy=expert                          completes the task
  kitchen-rollout --policy=my_module:act                   acts as your own function does
  kitchen-rollout --workers=4 --num_episodes=100           four processes on Ray play, here or on a cluster

Your own policy is a callable that takes a dm_env.TimeStep and returns the action. Files are written whole or not at
all. Ctrl-C keeps the episodes that are finished, but no video. Exit status: 0; 1 if writing, the physics or the
workers failed; 2 for a bad argument or policy, with one line on stderr; 130 if interrupted.
"""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from absl import flags

from kitchen_suite.cli import common
from kitchen_suite.cli.common import INTERRUPTED, USAGE
from kitchen_suite.cli.ray_flags import RayFlags
from kitchen_suite.rendering import gl
from kitchen_suite.workers.worker import ClusterError

# All else is imported late: dm_control must not be before the flags have told whether a GL library is needed.
if TYPE_CHECKING:
    from kitchen_suite.rollouts import rollout_job

_NAME = "kitchen-rollout"

# Flags of their own, not the global ones: the command can be called from other programs, any number of times.
_FLAGS = flags.FlagValues()

_DOMAIN_NAME = flags.DEFINE_string("domain_name", "kitchen", "Domain of the task; see --list.", flag_values=_FLAGS)
_TASK_NAME = flags.DEFINE_string(
    "task_name",
    None,
    "Task; see --list. Default: the domain's first benchmark task (kitchen: complete).",
    flag_values=_FLAGS,
)
_TASK_KWARGS = flags.DEFINE_string(
    "task_kwargs",
    "{}",
    """Further arguments of the task, as a JSON object, such as '{"robot_noise_ratio": 0}'.""",
    flag_values=_FLAGS,
)
_TIME_LIMIT = flags.DEFINE_float(
    "time_limit", None, "Length of an episode in seconds. Default: the task's.", flag_values=_FLAGS
)
_POLICY = flags.DEFINE_string(
    "policy",
    "random",
    "What acts: random (uniform; standard normal where the action is unbounded), zero, expert (scripted; needs the "
    "extra experts; takes options, as in 'expert(speed=0.8, jitter=0.02)'), trained (what comes with the package; or "
    "\"trained(file='policy.npz')\"), or module:callable, which is given the "
    "dm_env.TimeStep and returns the action.",
    flag_values=_FLAGS,
)
_NUM_EPISODES = flags.DEFINE_integer("num_episodes", 3, "Number of episodes.", lower_bound=1, flag_values=_FLAGS)
_SEED = flags.DEFINE_integer(
    "seed",
    0,
    "Seed of the first episode; each further one has the next. A seed fixes an episode.",
    lower_bound=0,
    flag_values=_FLAGS,
)
_RAY = RayFlags(_FLAGS)
_OUTPUT = flags.DEFINE_string(
    "output",
    None,
    "Folder to write the episodes to, as episode_000000.npz and so on; it must not hold any yet.",
    flag_values=_FLAGS,
)
_VIDEO = flags.DEFINE_string(
    "video", None, "Video of all episodes, an .mp4 in an existing folder; replaced if it is there.", flag_values=_FLAGS
)
_VIDEO_FPS = flags.DEFINE_float(
    "video_fps", 25.0, "Greatest number of frames in a second of the video.", lower_bound=0.1, flag_values=_FLAGS
)
_CAMERA = flags.DEFINE_string("camera", "overview", "Camera of the video, by name or number.", flag_values=_FLAGS)
_WIDTH = flags.DEFINE_integer("width", 640, "Width of the video in pixels.", lower_bound=2, flag_values=_FLAGS)
_HEIGHT = flags.DEFINE_integer("height", 480, "Height of the video in pixels.", lower_bound=2, flag_values=_FLAGS)
_VISUALIZE_REWARD = flags.DEFINE_boolean(
    "visualize_reward", False, "Show in the video what the reward depends on by its colour.", flag_values=_FLAGS
)
_LIST = flags.DEFINE_boolean("list", False, "List domains, tasks and cameras, and exit.", flag_values=_FLAGS)
_HELP = flags.DEFINE_boolean("help", False, "Show this help, and exit.", short_name="h", flag_values=_FLAGS)


@flags.validator("task_kwargs", flag_values=_FLAGS)
def _check_task_kwargs(text: str) -> bool:
    common.check_json_object(text)
    if taken := sorted(json.loads(text).keys() & {"random", "time_limit", "visuals"}):
        raise flags.ValidationError(f"{', '.join(taken)} cannot be given here: see --seed, --time_limit and --video")
    return True


@flags.validator("output", flag_values=_FLAGS)
def _check_output(path: str | None) -> bool:
    if path is not None and (not path or (Path(path).exists() and not Path(path).is_dir())):
        raise flags.ValidationError("is not a folder")
    return True


flags.register_validator("video", common.check_video, flag_values=_FLAGS)


@flags.validator("width", message="must be even", flag_values=_FLAGS)
@flags.validator("height", message="must be even", flag_values=_FLAGS)
def _check_even(pixels: int) -> bool:
    return pixels % 2 == 0


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
            run = _show_help
        else:
            gl.prepare(rendering=_VIDEO.value is not None and not _LIST.value)
            run = _prepare_list() if _LIST.value else _prepare_rollout()
    except KeyboardInterrupt:
        return common.fail(_NAME, "interrupted", INTERRUPTED)
    except (flags.Error, ImportError, OSError, TypeError, ValueError) as error:
        return common.fail(_NAME, error, USAGE)
    return run()


def console_main() -> int:
    """Runs the command as a process of its own; returns the exit status."""
    return common.run_as_process(main)


def _show_help() -> int:
    print(common.describe(_FLAGS, __doc__))
    return 0


def _prepare_list() -> Callable[[], int]:
    from kitchen_suite.rollouts import rollout_job

    text = rollout_job.describe_suite()

    def show() -> int:
        print(text)
        return 0

    return show


def _prepare_rollout() -> Callable[[], int]:
    from kitchen_suite.rollouts import rollout_job

    settings = rollout_job.Settings(
        domain_name=_DOMAIN_NAME.value,
        task_name=_TASK_NAME.value,
        task_kwargs=_task_kwargs(),
        policy=_POLICY.value,
        num_episodes=_NUM_EPISODES.value,
        seed=_SEED.value,
        output=Path(_OUTPUT.value) if _OUTPUT.value else None,
        video=Path(_VIDEO.value) if _VIDEO.value else None,
        camera=_CAMERA.value,
        width=_WIDTH.value,
        height=_HEIGHT.value,
        visualize_reward=_VISUALIZE_REWARD.value,
        video_fps=_VIDEO_FPS.value,
        cluster=_RAY.cluster(),
    )
    job = rollout_job.RolloutJob(settings)
    return lambda: _run(job)


def _task_kwargs() -> dict[str, Any]:
    limit = {} if _TIME_LIMIT.value is None else {"time_limit": _TIME_LIMIT.value}
    return {**json.loads(_TASK_KWARGS.value), **limit}


def _run(job: "rollout_job.RolloutJob") -> int:
    from dm_control.rl.control import PhysicsError

    from kitchen_suite.policies import PolicyError

    return common.perform(
        _NAME,
        job.run,
        interrupted=lambda: f"interrupted after {job.finished} of {_NUM_EPISODES.value} episodes",
        failures=(ClusterError, PhysicsError, OSError),
        misuses=(PolicyError,),
    )


if __name__ == "__main__":
    sys.exit(console_main())

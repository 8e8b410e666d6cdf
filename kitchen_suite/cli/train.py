"""Trains a policy by PPO on many environments at once. Needs no display, but the extra `train`.

  kitchen-train --output=runs/drawer                           opens the top drawer
  kitchen-train --output=runs/drawer --resume                  goes on where an interrupted run stopped
  kitchen-train --output=runs/hold --task_kwargs='{"gripper": "deterministic"}'
  kitchen-train --output=runs/kettle --env=kitchen --task_name=kettle --demonstrations=kettle
                                                               clones what kitchen-record has written, then goes on
  kitchen-train --output=runs/small --hyperparameters='{"num_envs": 512, "hidden": [128, 64]}'
  kitchen-train --output=runs/film --video=film.mp4            films an episode of the best policy at the end
  tensorboard --logdir=runs                                    shows the curves, also while training goes on

The folder gets one of its own for each seed: curves for TensorBoard, the last checkpoints, and `policy.npz`, the best
policy that an evaluation on held-out seeds has found; `kitchen-play --policy_file=...` plays it. A seed that comes to
no progress is given up for the next one. Exit status: 0; 1 if writing or the physics failed, learning
diverged, or no checkpoint can be read; 2 for a bad argument, with one line on stderr; 130 if interrupted.
"""

import importlib.util
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from absl import flags

from kitchen_suite.cli import common
from kitchen_suite.cli.common import INTERRUPTED, USAGE
from kitchen_suite.rendering import gl

# All else is imported late: dm_control must not be before it is settled that no GL library is needed.
if TYPE_CHECKING:
    from kitchen_suite.training import train_job

_NAME = "kitchen-train"

# What the extra `train` installs.
_NEEDS = ("skrl", "tensorboard", "torch")

# Flags of their own, not the global ones: the command can be called from other programs, any number of times.
_FLAGS = flags.FlagValues()

_ENV = flags.DEFINE_string("env", "open_cabinet", "Domain of the task; see kitchen-rollout --list.", flag_values=_FLAGS)
_TASK_NAME = flags.DEFINE_string(
    "task_name", None, "Task. Default: the domain's first benchmark task.", flag_values=_FLAGS
)
_TASK_KWARGS = flags.DEFINE_string(
    "task_kwargs",
    "{}",
    """Further arguments of the task, as a JSON object, such as '{"gripper": "deterministic"}'.""",
    flag_values=_FLAGS,
)
_HYPERPARAMETERS = flags.DEFINE_string(
    "hyperparameters",
    "{}",
    "Changes to the domain's own, as a JSON object; names are the attributes of training.Hyperparameters.",
    flag_values=_FLAGS,
)
_NUM_STEPS = flags.DEFINE_integer(
    "num_steps", 49_000_000, "Control steps of a seed, over all environments.", lower_bound=1, flag_values=_FLAGS
)
_EVAL_INTERVAL = flags.DEFINE_integer(
    "eval_interval", 500_000, "Control steps between evaluations and checkpoints.", lower_bound=1, flag_values=_FLAGS
)
_EVAL_EPISODES = flags.DEFINE_integer(
    "eval_episodes", 100, "Episodes of an evaluation, on seeds held out.", lower_bound=1, flag_values=_FLAGS
)
_TARGET_SUCCESS = flags.DEFINE_float(
    "target_success",
    0.99,
    "Rate of success in two evaluations in a row that ends the training early; above 1 for never.",
    lower_bound=0.0,
    flag_values=_FLAGS,
)
_PATIENCE = flags.DEFINE_integer(
    "patience",
    8_000_000,
    "Control steps after which a seed is given up if no evaluation has come to --least_progress; 0 for never.",
    lower_bound=0,
    flag_values=_FLAGS,
)
_LEAST_PROGRESS = flags.DEFINE_float(
    "least_progress",
    0.05,
    "Mean opening [m], or mean number of kitchen tasks completed, that counts as progress.",
    lower_bound=0.0,
    flag_values=_FLAGS,
)
_SEED = flags.DEFINE_integer("seed", 0, "Seed of networks and environments.", lower_bound=0, flag_values=_FLAGS)
_RESTARTS = flags.DEFINE_integer(
    "restarts", 3, "How many further seeds may be tried where one is given up.", lower_bound=0, flag_values=_FLAGS
)
_NUM_THREADS = flags.DEFINE_integer(
    "num_threads", None, "Threads that step environments. Default: one a processor.", lower_bound=1, flag_values=_FLAGS
)
_DEMONSTRATIONS = flags.DEFINE_string(
    "demonstrations", None, "Folder written by kitchen-record, to be cloned before all else.", flag_values=_FLAGS
)
_OUTPUT = flags.DEFINE_string("output", None, "Folder of the run.", flag_values=_FLAGS)
_VIDEO = flags.DEFINE_string(
    "video",
    None,
    "Video of an episode of the best policy, made at the end; an .mp4 in an existing folder, replaced if it is there.",
    flag_values=_FLAGS,
)
_RESUME = flags.DEFINE_boolean("resume", False, "Go on with the run in the folder.", flag_values=_FLAGS)
_HELP = flags.DEFINE_boolean("help", False, "Show this help, and exit.", short_name="h", flag_values=_FLAGS)


flags.register_validator("video", common.check_video, flag_values=_FLAGS)


@flags.validator("task_kwargs", flag_values=_FLAGS)
@flags.validator("hyperparameters", flag_values=_FLAGS)
def _check_object(text: str) -> bool:
    return common.check_json_object(text)


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
        job = _prepare()
    except KeyboardInterrupt:
        return common.fail(_NAME, "interrupted", INTERRUPTED)
    except (flags.Error, ImportError, OSError, TypeError, ValueError) as error:
        return common.fail(_NAME, error, USAGE)
    return _run(job)


def console_main() -> int:
    """Runs the command as a process of its own; returns the exit status."""
    return common.run_as_process(main)


def _prepare() -> "train_job.TrainJob":
    if not _OUTPUT.value:
        raise ValueError("--output is missing: name a folder for the run")
    if missing := [name for name in _NEEDS if not importlib.util.find_spec(name)]:
        raise ImportError(f"training needs {' and '.join(missing)}: pip install 'kitchen-suite[train]'")
    gl.prepare(rendering=_VIDEO.value is not None)
    from kitchen_suite.training import train_job
    from kitchen_suite.training.seed_run import Schedule

    settings = train_job.Settings(
        domain_name=_ENV.value,
        task_name=_TASK_NAME.value,
        task_kwargs=json.loads(_TASK_KWARGS.value),
        hyperparameters=json.loads(_HYPERPARAMETERS.value),
        schedule=Schedule(
            num_steps=_NUM_STEPS.value,
            eval_interval=_EVAL_INTERVAL.value,
            eval_episodes=_EVAL_EPISODES.value,
            target_success=_TARGET_SUCCESS.value,
            patience=_PATIENCE.value,
            least_progress=_LEAST_PROGRESS.value,
        ),
        seed=_SEED.value,
        restarts=_RESTARTS.value,
        num_threads=_NUM_THREADS.value,
        demonstrations=Path(_DEMONSTRATIONS.value) if _DEMONSTRATIONS.value else None,
        output=Path(_OUTPUT.value),
        resume=_RESUME.value,
        video=Path(_VIDEO.value) if _VIDEO.value else None,
    )
    return train_job.TrainJob(settings)


def _run(job: "train_job.TrainJob") -> int:
    from dm_control.rl.control import PhysicsError

    from kitchen_suite.training.checkpoints import CheckpointError
    from kitchen_suite.training.learner import DivergedError

    return common.perform(
        _NAME,
        job.run,
        interrupted=lambda: "interrupted; the same with --resume goes on from the last checkpoint",
        failures=(CheckpointError, DivergedError, OSError, PhysicsError),
    )


if __name__ == "__main__":
    sys.exit(console_main())

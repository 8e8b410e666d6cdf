"""Records episodes of a task, many at once, each from its own seed. Needs no display.

  kitchen-record --output=runs                                a hundred episodes of random actions in the kitchen
  kitchen-record --output=runs --task_name=kettle --seed=7    another task, other seeds
  kitchen-record --output=runs --dataset=me/kitchen-v0        also makes a Minari dataset of them
  kitchen-record --output=runs --num_episodes=1000            goes on where an earlier run in that folder ended
  kitchen-record --output=runs --workers=4                    four processes on Ray play, here or on a cluster

Episode i of --seed=S has the seed S+i and is the same however many are played at once. Its file is written whole or
not at all, so that an interrupt, even by kill -9, loses only the episodes that were being played; the same command
completes the recording. Exit status: 0; 1 if writing, the physics or the workers failed; 2 for a bad argument or
policy, with one line on stderr; 130 if interrupted.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from absl import flags

from kitchen_suite.cli import common
from kitchen_suite.cli.common import INTERRUPTED, USAGE
from kitchen_suite.cli.ray_flags import RayFlags
from kitchen_suite.recordings import minari_root
from kitchen_suite.rendering import gl
from kitchen_suite.workers.worker import ClusterError

# All else is imported late: dm_control must not be before it is settled that no GL library is needed.
if TYPE_CHECKING:
    from kitchen_suite.recordings import record_job

_NAME = "kitchen-record"

# Flags of their own, not the global ones: the command can be called from other programs, any number of times.
_FLAGS = flags.FlagValues()

_DOMAIN_NAME = flags.DEFINE_string(
    "domain_name", "kitchen", "Domain of the task; see kitchen-rollout --list.", flag_values=_FLAGS
)
_TASK_NAME = flags.DEFINE_string(
    "task_name", None, "Task. Default: the domain's first benchmark task (kitchen: complete).", flag_values=_FLAGS
)
_TASK_KWARGS = flags.DEFINE_string(
    "task_kwargs",
    "{}",
    """Further arguments of the Gymnasium environment, as a JSON object, such as '{"goal_format": "flat"}'.""",
    flag_values=_FLAGS,
)
_POLICY = flags.DEFINE_string(
    "policy",
    "random",
    "What acts: as in kitchen-rollout. A module:callable must remember nothing from call to call, as calls of many "
    "episodes alternate, or be given --num_envs=1.",
    flag_values=_FLAGS,
)
_NUM_EPISODES = flags.DEFINE_integer("num_episodes", 100, "Number of episodes.", lower_bound=1, flag_values=_FLAGS)
_SEED = flags.DEFINE_integer(
    "seed",
    0,
    "Seed of the first episode; each further one has the next. A seed fixes an episode.",
    lower_bound=0,
    flag_values=_FLAGS,
)
_MAX_EPISODE_STEPS = flags.DEFINE_integer(
    "max_episode_steps",
    None,
    "Control steps after which an episode is truncated. Default: the environment's.",
    lower_bound=1,
    flag_values=_FLAGS,
)
_NUM_ENVS = flags.DEFINE_integer(
    "num_envs", 16, "Episodes played at once, by each worker.", lower_bound=1, flag_values=_FLAGS
)
_NUM_THREADS = flags.DEFINE_integer(
    "num_threads",
    None,
    "Threads that play them. Default: one a processor; with --workers, one in each.",
    lower_bound=1,
    flag_values=_FLAGS,
)
_RAY = RayFlags(_FLAGS)
_OUTPUT = flags.DEFINE_string(
    "output",
    None,
    "Folder for the episodes, as episode_000000.npz and so on; a recording of the same that is there is completed.",
    flag_values=_FLAGS,
)
_DATASET = flags.DEFINE_string(
    "dataset",
    None,
    "Minari dataset to make of the episodes once all are there, such as kitchen-suite/complete-random-v0.",
    flag_values=_FLAGS,
)
_DATA_PATH = flags.DEFINE_string(
    "data_path", None, "Folder of the Minari datasets. Default: Minari's own.", flag_values=_FLAGS
)
_HELP = flags.DEFINE_boolean("help", False, "Show this help, and exit.", short_name="h", flag_values=_FLAGS)


flags.register_validator("task_kwargs", common.check_json_object, flag_values=_FLAGS)


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
    except flags.Error as error:
        return common.fail(_NAME, error, USAGE)
    with minari_root.datasets_in(_DATA_PATH.value):
        try:
            job = _prepare()
        except KeyboardInterrupt:
            return common.fail(_NAME, "interrupted", INTERRUPTED)
        except (ImportError, OSError, TypeError, ValueError) as error:
            return common.fail(_NAME, error, USAGE)
        return _run(job)


def console_main() -> int:
    """Runs the command as a process of its own; returns the exit status."""
    return common.run_as_process(main)


def _prepare() -> "record_job.RecordJob":
    if not _OUTPUT.value:
        raise ValueError("--output is missing: name a folder for the episodes")
    gl.prepare(rendering=False)
    from kitchen_suite.recordings import record_job

    settings = record_job.Settings(
        domain_name=_DOMAIN_NAME.value,
        task_name=_TASK_NAME.value,
        task_kwargs=json.loads(_TASK_KWARGS.value),
        policy=_POLICY.value,
        num_episodes=_NUM_EPISODES.value,
        seed=_SEED.value,
        max_episode_steps=_MAX_EPISODE_STEPS.value,
        num_envs=_NUM_ENVS.value,
        num_threads=_NUM_THREADS.value,
        cluster=_RAY.cluster(),
        output=Path(_OUTPUT.value),
        dataset=_DATASET.value,
    )
    return record_job.RecordJob(settings)


def _run(job: "record_job.RecordJob") -> int:
    from kitchen_suite.policies import PolicyError
    from kitchen_suite.recordings.record_job import DivergedError

    return common.perform(
        _NAME,
        job.run,
        interrupted=lambda: (
            f"interrupted after {job.finished} of {_NUM_EPISODES.value} episodes; run the same again to go on"
        ),
        failures=(ClusterError, DivergedError, OSError),
        misuses=(PolicyError,),
    )


if __name__ == "__main__":
    sys.exit(console_main())

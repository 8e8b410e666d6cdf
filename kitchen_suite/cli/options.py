"""Every flag of every command, described once: its help, and the values that it takes.

The flags of a command are the fields of its settings dataclass, which has their types and defaults. `OPTIONS` has the
same help for a field of one name in every command, and the order in which `--help` lists them; `flag_parsing` defines
the flags. `metadata["unset"]` of a field replaces `Option.unset` where something else applies without the flag.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite import checks
from kitchen_suite.cli import option_checks
from kitchen_suite.evaluation.protocols import PROTOCOLS

_MAX_STEPS = 10**12

# Longer episodes would exceed the 512 MiB of arrays that `files.load_arrays` reads: a control step takes up to 2 KiB.
_MAX_EPISODE_STEPS = 100_000

# Size of the models' offscreen buffers [pixels].
_MAX_WIDTH, _MAX_HEIGHT = 1920, 1440


@dataclasses.dataclass(frozen=True)
class Option:
    """The help of a flag, and the values that it accepts.

    Attributes:
      help: one or two sentences, without the default.
      minimum: least value of a number.
      maximum: greatest value of a number.
      choices: values of a string; any when empty.
      unset: what applies without the flag, where it has no default.
      check: raises a ValueError for a value that is refused.
    """

    help: str
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    unset: str = ""
    check: Callable[[Any], None] = lambda value: None


OPTIONS: Mapping[str, Option] = MappingProxyType(
    {
        "source": Option(
            "Folder of kitchen-record or kitchen-rollout, or Minari or LeRobot dataset, to replay; for "
            "kitchen-convert, HDF5 file of D4RL, or Minari dataset."
        ),
        "list": Option(
            "List all domains with their tasks and cameras, and exit; for kitchen-play, the trained policies that come "
            "with the package."
        ),
        "measure": Option(
            "speed: control steps per second as ratios; scaling: by number of environments and threads, with memory; "
            "soak: memory in the course of a long run; rendering: frames per second, and what a frame costs.",
            choices=("speed", "scaling", "soak", "rendering"),
        ),
        "protocol": Option(
            "Protocol of the evaluation: it sets task, variations, seeds and number of episodes.",
            choices=tuple(PROTOCOLS),
        ),
        "domain_name": Option("Domain of the task; kitchen-rollout --list shows all."),
        "task_name": Option("Task of the domain.", unset="its first benchmark task (kitchen: complete), or its first"),
        "task_kwargs": Option(
            "Arguments of the task's Gymnasium environment, as a JSON object such as '{\"robot_noise_ratio\": 0}'."
        ),
        "control_mode": Option(
            "Meaning of the action, such as joint_position or ee_delta_pose; see docs/control_modes.md.",
            unset="the domain's",
        ),
        "variations": Option(
            "Groups of parameters that vary from episode to episode, such as start,dynamics; or distributions by "
            "parameter, as a JSON object; see docs/variations.md.",
            unset="none",
        ),
        "variation_split": Option(
            "Distributions of the groups: seen, or held_out.", choices=("seen", "held_out"), unset="seen"
        ),
        "variation_values": Option(
            "Values of parameters that vary, in place of drawn ones, as a JSON object such as '{\"kettle/mass\": 1}'."
        ),
        "policy": Option(
            "random, zero, expert, trained, or module:callable, which takes a dm_env.TimeStep and returns the action. "
            "expert and trained take options, as in 'expert(speed=0.8)' and \"trained(file='policy.npz')\"."
        ),
        "shipped": Option("Name of a trained policy that comes with the package."),
        "policy_file": Option("File of a trained policy, written by kitchen-train."),
        "episodes": Option("Which episodes: all, or numbers and ranges such as 0,5,7-9."),
        "num_episodes": Option("Number of episodes; kitchen-replay spreads them evenly.", minimum=1, maximum=1_000_000),
        "seed": Option("First seed; further episodes, or restarts of a training, have the next ones.", minimum=0),
        "max_episode_steps": Option(
            "Control steps after which an episode ends.", minimum=1, maximum=_MAX_EPISODE_STEPS, unset="the domain's"
        ),
        "num_steps": Option(
            "Control steps in total, over all environments; training may end earlier: see --target_success.",
            minimum=0,
            maximum=_MAX_STEPS,
            unset="of the measure; of the domain",
        ),
        "num_envs": Option(
            "Number of environments stepped together.", minimum=1, maximum=checks.MAX_ENVS, unset="of the measure"
        ),
        "num_threads": Option(
            "Threads that step the environments.", minimum=1, maximum=checks.MAX_THREADS, unset="one per processor"
        ),
        "workers": Option("Processes on Ray that play the episodes; needs the extra ray.", minimum=1, maximum=10_000),
        "ray_address": Option(
            "Ray cluster of the workers: HOST:PORT, ray://HOST:PORT, or auto.", unset="started for the command"
        ),
        "rounds": Option("Rounds that count.", minimum=1, maximum=1_000_000),
        "training_kwargs": Option(
            "Arguments of the environments trained in, not of those evaluated in, as a JSON object; they replace the "
            "domain's."
        ),
        "hyperparameters": Option("Changes to the domain's hyperparameters, as a JSON object."),
        "algorithm": Option("Algorithm: ppo, or bc, flow or vqbet, which imitate --demonstrations."),
        "num_demonstrations": Option(
            "Episodes to learn from; or a number for each folder.",
            minimum=1,
            maximum=10**9,
            unset="all",
        ),
        "demonstrations": Option("Folders of kitchen-record, separated by commas; PPO clones them first."),
        "initial_policy": Option("File of a trained policy to start from.", unset="from scratch"),
        "eval_interval": Option(
            "Control steps between evaluations, each followed by a checkpoint.",
            minimum=1,
            maximum=_MAX_STEPS,
            unset="the domain's",
        ),
        "eval_episodes": Option("Episodes of an evaluation, on seeds held out.", minimum=1, maximum=checks.MAX_ENVS),
        "target_success": Option(
            "Success rate of two evaluations in a row that ends training; above 1: never.", 0.0, unset="the domain's"
        ),
        "patience": Option(
            "Control steps without --min_progress after which a seed is given up; 0: never.",
            minimum=0,
            maximum=_MAX_STEPS,
            unset="the domain's",
        ),
        "min_progress": Option("Mean opening [m], or tasks completed, that counts as progress.", minimum=0.0),
        "restarts": Option("Number of further seeds to try where one is given up.", minimum=0, maximum=1_000_000),
        "resume": Option(
            "Continue the run in the folder from its newest checkpoint; for kitchen-evaluate, the evaluation in it."
        ),
        "preset": Option(
            "Set of demonstrations, of its own task and policy: one of the domain's presets.", unset="none"
        ),
        "output": Option("Folder to write to.", check=option_checks.check_folder),
        "format": Option(
            "Format of the dataset: minari or lerobot.", choices=("minari", "lerobot"), unset="minari with --dataset"
        ),
        "dataset": Option(
            "Name of a dataset to make of the episodes, such as kitchen-suite/complete-random-v0 (Minari) or me/kettle "
            "(LeRobot)."
        ),
        "data_path": Option("Folder of the datasets.", unset="Minari's or LeRobot's own"),
        "json": Option(
            "kitchen-benchmark: print JSON in place of tables. kitchen-evaluate: file to write the results to as JSON, "
            "which is replaced if it is there.",
            check=option_checks.check_file,
        ),
        "video": Option(
            "Video to write, an .mp4 in an existing folder; one that is there is replaced.",
            unset="none; kitchen-play writes kitchen-play.mp4 where it can",
            check=option_checks.check_video,
        ),
        "novideo": Option("Write no video."),
        "video_episodes": Option("Number of episodes in the video, the first ones.", minimum=1, maximum=1_000_000),
        "video_fps": Option("Maximum number of frames per second of the video.", minimum=0.1, maximum=10_000),
        "port": Option("Port of the page, on this machine alone.", minimum=1024, maximum=65535),
        "web": Option(
            "Web page to write, an .html in an existing folder, which shows the episodes in 3-D; one that is there is "
            "replaced.",
            unset="none",
            check=option_checks.check_page,
        ),
        "web_episodes": Option("Number of episodes in the web page, the first ones.", minimum=1, maximum=1000),
        "render_quality": Option(
            "high; or fast: a video without shadows, reflections, sky and multisampling, and with fewer faces.",
            choices=("high", "fast"),
        ),
        "camera": Option("Camera of the video and the page, by name or number."),
        "width": Option(
            "Width of the video [pixels], even.", minimum=2, maximum=_MAX_WIDTH, check=option_checks.check_even
        ),
        "height": Option(
            "Height of the video [pixels], even.", minimum=2, maximum=_MAX_HEIGHT, check=option_checks.check_even
        ),
        "visualize_reward": Option("Colour objects in the video while they count as a success."),
        "help": Option("Show this help, and exit."),
        "version": Option("Show the version of the suite, and exit."),
    }
)


# Names that flags had in earlier versions, or have in similar programs.
RENAMED: Mapping[str, str] = MappingProxyType(
    {
        "env": "domain_name",
        "domain": "domain_name",
        "task": "task_name",
        "time_limit": "max_episode_steps",
        "steps": "max_episode_steps",
        "control_steps": "num_steps",
        "environments": "num_envs",
        "sizes": "num_envs",
        "episodes": "num_episodes",
        "least_progress": "min_progress",
        "video_file": "video",
    }
)

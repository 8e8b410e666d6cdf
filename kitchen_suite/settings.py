"""Settings of the commands: each field is the flag of its name, with the field's type, default and `Flag`.

`--help` lists the flags in the order of the fields, those of bases last. Flags that several commands have stand before
the settings.
"""

# ruff: noqa: RUF009, each call of `flag` makes a field of its own

import dataclasses
import functools
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kitchen_suite import checks, files, suite
from kitchen_suite.names import PHYSICS

if TYPE_CHECKING:
    from kitchen_suite.workers.cluster import RaySettings

WIDTH = 100  # Characters in a line that a command prints.

# Exit statuses of the commands.
SUCCESS, FAILURE, USAGE, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141

# Beginning of the names of the observation types with pictures; a GL library is chosen before these can be imported.
PICTURES_PREFIX = "pixels"

_MAX_STEPS = 10**12
MAX_COUNT = 10**6
MAX_SEED = 2**63 - 1  # Of results and datasets: msgspec and HDF5 have 64 bits.

# Longer episodes would exceed the 512 MiB of arrays that `files.load_arrays` reads: a control step takes up to 2 KiB.
MAX_EPISODE_STEPS = 100_000

# Size of the models' offscreen buffers [pixels].
_MAX_WIDTH, _MAX_HEIGHT = 1920, 1440


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flag:
    """The help of a flag, one or two sentences without the default, and the values that it accepts.

    Attributes:
      choices: values of a string; any when empty.
      unset: what applies without the flag, where it has no default; or a function that returns it for the help.
      check: raises a ValueError for a value that is refused.
    """

    help: str
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    unset: str | Callable[[], str] = ""
    check: Callable[[Any], None] = lambda value: None


def flag(help: str, default: Any = dataclasses.MISSING, **accepted: Any) -> Any:
    """Returns a field of settings; it is required without a default, and `accepted` are attributes of its `Flag`."""
    metadata = {"flag": Flag(help=help, **accepted)}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=default.copy, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def check_even(pixels: int) -> None:
    """Raises a ValueError for an odd number."""
    if pixels % 2:
        raise ValueError("must be even")


def check_folder(path: Path) -> None:
    """Raises a ValueError for a path that exists and is no folder."""
    if path.exists() and not path.is_dir():
        raise ValueError("is not a folder")


def check_file(path: Path, suffix: str = "") -> None:
    """Raises a ValueError for a path that cannot be written to as a file whose name ends with a suffix."""
    if not path.name.endswith(suffix) or (path.exists() and not path.is_file()):
        raise ValueError(f"must be a file that ends with {suffix}" if suffix else "is not a file")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise ValueError(f"there is no folder {str(path.parent)!r} that may be written to")


domain_flag = functools.partial(
    flag,
    "Domain: kitchen, kitchens (generated ones) or another of kitchen-rollout --list; module:NAME is your own.",
)
task_flag = functools.partial(
    flag,
    "Task of the domain; all, in the kitchen, is seven of its twenty.",
    unset="its first benchmark task (kitchen: complete), or its first",
)
control_mode_flag = functools.partial(
    flag,
    "Meaning of the action, such as joint_position or ee_delta_pose; see docs/guide/control_modes.md.",
    unset="the domain's",
)
control_timestep_flag = functools.partial(
    flag, "Length of a control step [s], a whole number of physics steps.", unset="the domain's"
)
physics_flag = functools.partial(
    flag, "exact, or fast: longer steps, for training.", choices=PHYSICS, unset="the domain's"
)
variations_flag = functools.partial(
    flag,
    "Groups of parameters that vary from episode to episode, such as start,dynamics; or distributions by parameter, as "
    "a JSON object; see docs/guide/variations.md.",
    unset="none",
)
variation_split_flag = functools.partial(
    flag, "Distributions of the groups: seen, or held_out.", choices=("seen", "held_out"), unset="seen"
)
obs_type_flag = functools.partial(
    flag,
    "Observation type, such as state or pixels_agent_pos; see docs/guide/observations.md.",
    unset="the domain's",
)
policy_flag = functools.partial(
    flag,
    "random, zero, expert, trained, ws://host:port; module:callable, of a dm_env.TimeStep; or gym:module:callable, of "
    "Gymnasium's observation. Options as in 'expert(speed=0.8)' and \"trained(file='policy.npz')\".",
)
seed_flag = functools.partial(
    flag, "First seed; further episodes, or restarts of a training, have the next ones.", minimum=0
)
num_episodes_flag = functools.partial(flag, "Number of episodes.", minimum=1, maximum=MAX_COUNT)
max_episode_steps_flag = functools.partial(
    flag, "Control steps after which an episode ends.", minimum=1, maximum=MAX_EPISODE_STEPS, unset="the domain's"
)
num_envs_flag = functools.partial(flag, "Number of environments stepped together.", minimum=1, maximum=checks.MAX_ENVS)
num_threads_flag = functools.partial(
    flag, "Threads that step the environments.", minimum=1, maximum=checks.MAX_THREADS, unset="one per processor"
)
output_flag = functools.partial(flag, "Folder to write to.", check=check_folder)
format_flag = functools.partial(
    flag,
    "Format of the dataset: minari, lerobot, robomimic, ogbench, d4rl, diffusion_policy or bet.",
    unset="minari with --dataset",
)
dataset_flag = functools.partial(
    flag,
    "Name of a dataset to make of the episodes, such as kitchen-suite/complete-random-v0 (Minari) or me/kettle "
    "(LeRobot).",
)
data_path_flag = functools.partial(flag, "Folder of the datasets.", unset="Minari's or LeRobot's own")
camera_flag = functools.partial(flag, "Camera of the video and the page, by name or number.")
video_flag = functools.partial(
    flag,
    "Video to write, an .mp4 in an existing folder; an existing video is replaced.",
    unset="none",
    check=functools.partial(check_file, suffix=".mp4"),
)
video_fps_flag = functools.partial(
    flag, "Maximum number of frames per second of the video.", minimum=0.1, maximum=10_000
)
render_quality_flag = functools.partial(
    flag,
    "high; or fast: a video without shadows, reflections, sky and multisampling, and with fewer faces.",
    choices=("high", "fast"),
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """The task of a command."""

    domain_name: str = domain_flag("kitchen")
    task_name: str | None = task_flag(None)
    task_kwargs: Mapping[str, Any] = flag(
        "Arguments of the task's Gymnasium environment, as a JSON object such as '{\"robot_noise_ratio\": 0}'.", {}
    )
    physics: str | None = physics_flag(None)
    obs_type: str | None = obs_type_flag(None)
    control_mode: str | None = control_mode_flag(None)
    control_timestep: float | None = control_timestep_flag(None)
    variations: str | None = variations_flag(None)
    variation_split: str | None = variation_split_flag(None)

    @property
    def environment_kwargs(self) -> dict[str, Any]:
        """Arguments of the task's Gymnasium environment; a ValueError if one is given twice, with different values."""
        names = ("physics", "obs_type", "control_mode", "control_timestep", "variations", "variation_split")
        given = {name: value for name in names if (value := getattr(self, name)) is not None}
        if self.variations is not None:
            given["variations"] = parsed_variations(self.variations)
        for name, value in given.items():
            if (other := self.task_kwargs.get(name, value)) != value:
                raise ValueError(f"{name} is {checks.shown(value)}, but {checks.shown(other)} in the task_kwargs")
        return {**self.task_kwargs, **given}

    @property
    def observes_pictures(self) -> bool:
        """Whether observations hold pictures, so that playing needs a GL library."""
        return str(self.obs_type or self.task_kwargs.get("obs_type")).startswith(PICTURES_PREFIX)


def parsed_variations(text: str) -> Any:
    """Returns what varies: a list of the names that commas separate, or what a text that begins as JSON holds."""
    if not text.lstrip().startswith("{"):
        return text.split(",")
    try:
        return files.parse_json(text)
    except ValueError as error:
        raise ValueError(f"variations cannot be read as JSON: {error}") from error


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSettings(TaskSettings):
    """The episodes of a task that a command plays."""

    policy: str = policy_flag("random")
    seed: int = seed_flag(0)
    max_episode_steps: int | None = max_episode_steps_flag(None)


@dataclasses.dataclass(frozen=True, kw_only=True)
class WorkerSettings(EpisodeSettings):
    """Episodes, and the processes that play them."""

    workers: int | None = flag(
        "Processes on Ray that play the episodes; needs the extra ray.", None, minimum=1, maximum=10_000
    )
    ray_address: str | None = flag(
        "Ray cluster of the workers: HOST:PORT, ray://HOST:PORT, or auto.", None, unset="started for the command"
    )

    def ray(self) -> "RaySettings | None":
        """Returns the workers that play the episodes, None where the command does; raises as `RaySettings.of`."""
        if self.workers is None:
            if self.ray_address:
                raise ValueError("--ray_address needs --workers: the number of processes there")
            return None
        from kitchen_suite import policies
        from kitchen_suite.workers.cluster import RaySettings

        if policies.player_of(self.policy):
            raise ValueError(f"a person plays {self.policy!r} in one process: leave out --workers")
        return RaySettings.of(self.workers, self.ray_address)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PageSettings:
    """The web page that a command writes."""

    web: Path | None = flag(
        "Web page to write, an .html in an existing folder, which shows the episodes in 3-D; an existing page is "
        "replaced.",
        None,
        unset="none",
        check=functools.partial(check_file, suffix=".html"),
    )
    web_episodes: int = flag("Number of episodes in the web page, the first ones.", 10, minimum=1, maximum=1000)
    camera: str = camera_flag("overview")


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmSettings(PageSettings):
    """The video and the web page that a command writes."""

    video: Path | None = video_flag(None)
    video_fps: float = video_fps_flag(25.0)
    width: int = flag("Width of the video [pixels], even.", 640, minimum=2, maximum=_MAX_WIDTH, check=check_even)
    height: int = flag("Height of the video [pixels], even.", 480, minimum=2, maximum=_MAX_HEIGHT, check=check_even)
    video_episodes: int = flag("Number of episodes in the video, the first ones.", 1, minimum=1, maximum=MAX_COUNT)
    render_quality: str = render_quality_flag("fast")

    @property
    def rendering(self) -> dict[str, Any]:
        """Arguments of the filmed environment; without pictures it is built without visuals, and steps faster."""
        return {"visuals": True if self.video or self.web else None, "render_quality": self.render_quality}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RolloutSettings(WorkerSettings, FilmSettings):
    """Settings of `kitchen-rollout`."""

    list: bool = flag("List all domains with their tasks and cameras, and exit.", False)
    num_episodes: int = num_episodes_flag(3)
    output: Path | None = output_flag(None)
    visualize_reward: bool = flag("Colour objects in the video while they count as a success.", False)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlaySettings(FilmSettings):
    """Settings of `kitchen-play`."""

    list: bool = flag("List the trained policies that come with the package, and exit.", False)
    shipped: str | None = flag("Name of a trained policy that comes with the package.", None)
    policy_file: Path | None = flag("File of a trained policy, written by kitchen-train.", None)
    num_episodes: int = num_episodes_flag(10)
    seed: int = seed_flag(0)
    max_episode_steps: int | None = max_episode_steps_flag(None)
    video: Path | None = video_flag(None, unset="kitchen-play.mp4, where it can be made, without --web")
    novideo: bool = flag("Write no video.", False)
    # Enough to follow a motion, and few enough to be rendered without a graphics card.
    video_fps: float = video_fps_flag(12.5)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordSettings(WorkerSettings):
    """Settings of `kitchen-record`; a preset sets task, policy, episodes and some `task_kwargs`, if not given."""

    output: Path = output_flag()
    preset: str | None = flag(
        "Set of demonstrations, of its own task and policy: one of the domain's presets.", None, unset="none"
    )
    num_episodes: int | None = num_episodes_flag(None, unset="the preset's, or 100")
    num_envs: int = num_envs_flag(16)
    num_threads: int | None = num_threads_flag(None)
    format: str | None = format_flag(None)
    dataset: str | None = dataset_flag(None)
    data_path: Path | None = data_path_flag(None)

    @property
    def resolved(self) -> "RecordSettings":
        """The settings with those of the preset; a ValueError where one of them is given another value.

        A preset only proposes the number of episodes, and leaves free those `task_kwargs` that it does not have.
        """
        presets = suite.find_domain(self.domain_name).resolve("recording") or {}
        chosen = {} if self.preset is None else dict(presets[checks.choice(self.preset, presets, "preset")])
        proposed = chosen.pop("num_episodes", 100)
        count = proposed if self.num_episodes is None else self.num_episodes
        arguments = {**self.task_kwargs, **chosen.pop("task_kwargs", {})}
        default = vars(RecordSettings(output=self.output))
        given = [name for name in chosen if vars(self)[name] not in (default[name], chosen[name])]
        given += [f"{name} of the task_kwargs" for name, value in self.task_kwargs.items() if arguments[name] != value]
        if given:
            raise ValueError(f"preset {self.preset!r} fixes {', '.join(sorted(given))}: leave it out, or the preset")
        return dataclasses.replace(self, **{**chosen, "num_episodes": count, "task_kwargs": arguments})


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplaySettings(FilmSettings):
    """Settings of `kitchen-replay`; `source` is its argument."""

    source: str = flag(
        "Recording to replay: folder of kitchen-record or kitchen-rollout, or Minari or LeRobot dataset."
    )
    episodes: str | None = flag("Which episodes: all, or numbers and ranges such as 0,5,7-9.", None)
    num_episodes: int = flag(
        "Number of episodes, spread evenly over the recording, without --episodes.", 10, minimum=1, maximum=MAX_COUNT
    )
    data_path: Path | None = data_path_flag(None)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConvertSettings:
    """Settings of `kitchen-convert`; `source` is its argument. Either `output` or `dataset` is named."""

    source: str = flag("Recording; dataset in files of another program; or demonstrations of people.")
    output: Path | None = flag("Folder of the recording to make.", None, check=check_folder)
    format: str | None = format_flag(None)
    dataset: str | None = dataset_flag(None)
    data_path: Path | None = data_path_flag(None)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchmarkSettings:
    """Settings of `kitchen-benchmark`."""

    measure: str = flag(
        "speed: control steps per second as ratios; scaling: by number of environments and threads, with memory; "
        "soak: memory in the course of a long run; rendering: frames per second, and what a frame costs.",
        "speed",
        choices=("speed", "scaling", "soak", "rendering"),
    )
    domain_name: str = domain_flag("kitchen")
    rounds: int = flag("Rounds that count.", 9, minimum=1, maximum=MAX_COUNT)
    max_episode_steps: int | None = max_episode_steps_flag(None)
    num_envs: tuple[int, ...] = flag(
        "Numbers of environments stepped together, such as 1,8,32.",
        (),
        minimum=1,
        maximum=checks.MAX_ENVS,
        unset="the measure's",
    )
    num_steps: int | None = flag(
        "Control steps in total, over all environments.", None, minimum=0, maximum=_MAX_STEPS, unset="the measure's"
    )
    json: bool = flag("Print JSON in place of tables.", False)


_OF_PROTOCOL = "the protocol's"


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluateSettings(TaskSettings, PageSettings):
    """Settings of `kitchen-evaluate`; those that are None, and `task_kwargs` that are not given, are the protocol's."""

    protocol: str = flag(
        "Protocol of the evaluation: it sets task, variations, seeds and number of episodes.", "default"
    )
    policy: str = policy_flag("random")
    task_name: str | None = task_flag(None, unset=_OF_PROTOCOL)
    control_mode: str | None = control_mode_flag(None, unset=_OF_PROTOCOL)
    control_timestep: float | None = control_timestep_flag(None, unset=_OF_PROTOCOL)
    variations: str | None = variations_flag(None, unset=_OF_PROTOCOL)
    variation_split: str | None = variation_split_flag(None, unset=_OF_PROTOCOL)
    seed: int | None = seed_flag(None, unset=_OF_PROTOCOL, maximum=MAX_SEED - MAX_COUNT)
    num_episodes: int | None = num_episodes_flag(None, unset=_OF_PROTOCOL)
    max_episode_steps: int | None = max_episode_steps_flag(None, unset=_OF_PROTOCOL)
    num_envs: int = num_envs_flag(16)
    num_threads: int | None = num_threads_flag(None)
    dataset: Path | None = flag("Folder of a recording, from whose episodes some protocols take their goals.", None)
    resume: bool = flag("Continue the evaluation in the folder.", False)
    output: Path | None = output_flag(None)
    json: Path | None = flag(
        "File to write the results to as JSON; an existing one is replaced.", None, check=check_file
    )
    receipt: Path | None = flag(
        "File to write a receipt to, an .npz, with which kitchen-verify checks the scores without the policy; an "
        "existing one is replaced.",
        None,
        check=functools.partial(check_file, suffix=".npz"),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerifySettings:
    """Settings of `kitchen-verify`; `receipt` is its argument."""

    receipt: str = flag("Receipt of kitchen-evaluate.")
    num_envs: int = num_envs_flag(16)
    num_threads: int | None = num_threads_flag(None)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CertifySettings:
    """Settings of `kitchen-certify`."""

    split: str = flag("train or test.", "train", choices=("train", "test"))
    designs: str = flag("Numbers of the kitchens, from the first to before the last, such as 0:1000.", "0:10")
    output: Path | None = flag(
        "File of certificates, which is completed.", None, unset="one in the cache folder", check=check_file
    )
    check: bool = flag("Certify again, and compare with the file.", False)
    num_workers: int | None = flag(
        "Processes that certify.", None, minimum=1, maximum=checks.MAX_THREADS, unset="one per processor"
    )

    @property
    def numbers(self) -> range:
        """The numbers of the kitchens; a ValueError where they are not two numbers, the lower one first."""
        first, _, last = self.designs.partition(":")
        if not (first.isdecimal() and last.isdecimal() and int(first) < int(last) <= MAX_COUNT):
            raise ValueError(f"designs must be two numbers such as 0:1000, got {checks.shown(self.designs)}")
        return range(int(first), int(last))


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoctorSettings:
    """Settings of `kitchen-doctor`, which has none."""


# Algorithms by the name of `--algorithm`; all but the first learn from recordings alone.
PPO = "ppo"
IMITATION = ("bc", "flow", "vqbet")
OFFLINE = ("offline_bc", "iql", "idql", "td3bc", "gcbc", "gciql")
ALGORITHMS = (PPO, *IMITATION, *OFFLINE)

# Values of a `Schedule` by imitation and by offline learning; by PPO, unless the domain's training recipe has others.
_OFFLINE_SCHEDULE = {"num_steps": 40_000, "eval_interval": 10_000, "target_success": 1.1, "patience": 0}
_IMITATION_SCHEDULE = {"num_steps": 8_000, "eval_interval": 4_000, "target_success": 1.1, "patience": 0}
_PPO_SCHEDULE = {"num_steps": 49_000_000, "eval_interval": 500_000, "target_success": 0.99, "patience": 8_000_000}


def _by_domain(name: str) -> str:
    """Returns the values of a `Schedule`'s field by domain and algorithm, for the help."""
    recipes = {domain.name: domain.resolve("training") for domain in suite.DOMAINS.values()}
    own = {domain: recipe.settings[name] for domain, recipe in recipes.items() if recipe and name in recipe.settings}
    values = {**{f" in {domain}": value for domain, value in own.items()}, " elsewhere": _PPO_SCHEDULE[name]}
    of_ppo = ", ".join(f"{value:,}{place}" for place, value in values.items())
    imitation, offline = _IMITATION_SCHEDULE[name], _OFFLINE_SCHEDULE[name]
    others = f"{imitation:,} by imitation" + (f", {offline:,} offline" if offline != imitation else "")
    return f"{of_ppo}; {others}"


def _schedule_flag(name: str, help: str, **accepted: Any) -> Any:
    return flag(help, None, unset=functools.partial(_by_domain, name), **accepted)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainSettings(TaskSettings):
    """Settings of `kitchen-train`; those that are None are the domain's or the algorithm's, see `schedule`.

    Steps are control steps over all environments, and steps of the optimiser in imitation.
    """

    output: Path = output_flag()
    algorithm: str = flag("ppo; bc, flow, vqbet; offline_bc, iql, idql, td3bc, gcbc or gciql.", PPO, choices=ALGORITHMS)
    training_kwargs: Mapping[str, Any] = flag(
        "Arguments of the environments trained in, not of those evaluated in, as a JSON object; they replace the "
        "domain's.",
        {},
    )
    hyperparameters: Mapping[str, Any] = flag("Changes to the domain's hyperparameters, as a JSON object.", {})
    demonstrations: tuple[Path, ...] = flag(
        "Folders of kitchen-record, separated by commas; PPO clones them first.", ()
    )
    num_demonstrations: tuple[int, ...] = flag(
        "Episodes to learn from; or a number for each folder.", (), minimum=1, maximum=10**9, unset="all"
    )
    initial_policy: Path | None = flag("File of a trained policy to start from.", None, unset="from scratch")
    num_steps: int | None = _schedule_flag(
        "num_steps", "Control steps of all environments, at most: see --target_success.", minimum=0, maximum=_MAX_STEPS
    )
    eval_interval: int | None = _schedule_flag(
        "eval_interval", "Control steps between evaluations and checkpoints.", minimum=1, maximum=_MAX_STEPS
    )
    eval_episodes: int = flag("Episodes of an evaluation, on seeds held out.", 100, minimum=1, maximum=checks.MAX_ENVS)
    target_success: float | None = _schedule_flag(
        "target_success", "Success rate of two evaluations in a row that ends training; above 1: never.", minimum=0
    )
    patience: int | None = _schedule_flag(
        "patience",
        "Control steps without --min_progress after which a seed is given up; 0: never.",
        minimum=0,
        maximum=_MAX_STEPS,
    )
    min_progress: float = flag("Mean opening [m], or tasks completed, that is progress.", 0.05, minimum=0)
    seed: int = seed_flag(0)
    restarts: int = flag("Number of further seeds to try where one is given up.", 3, minimum=0, maximum=MAX_COUNT)
    num_threads: int | None = num_threads_flag(None)
    resume: bool = flag("Continue the run in the folder from its newest checkpoint.", False)
    video: Path | None = video_flag(None)

    @property
    def schedule(self) -> "Schedule":
        """When to evaluate and when to stop, with the domain's values for those that are None."""
        recipe = suite.find_domain(self.domain_name).resolve("training")
        own = {} if recipe is None else recipe.settings
        defaults: dict[str, Any] = _OFFLINE_SCHEDULE if self.algorithm in OFFLINE else _IMITATION_SCHEDULE
        if self.algorithm == PPO:
            defaults = {**_PPO_SCHEDULE, **own}
        chosen = {field.name: getattr(self, field.name) for field in dataclasses.fields(Schedule)}
        return Schedule(**{name: defaults[name] if value is None else value for name, value in chosen.items()})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule:
    """When to evaluate the policy of a seed, and when to stop: `TrainSettings` in which none is None."""

    num_steps: int
    eval_interval: int
    eval_episodes: int
    target_success: float
    patience: int
    min_progress: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportSettings(TaskSettings):
    """Settings of `kitchen-export`."""

    output: Path = output_flag()
    seed: int = seed_flag(0)
    variation_values: Mapping[str, Any] = flag(
        "Values of parameters that vary, in place of drawn ones, as a JSON object such as '{\"kettle/mass\": 1}'.", {}
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ViewSettings(EpisodeSettings):
    """Settings of `kitchen-view`."""

    camera: str = camera_flag("overview")
    render_quality: str = render_quality_flag("fast")
    port: int = flag("Port of the page, on this machine alone.", 8080, minimum=1024, maximum=65535)
    # None where it is not given, which `kitchen-view` replaces.
    policy: str | None = policy_flag(None, unset="random; with teleop none")  # type: ignore[assignment]
    teleop: bool = flag("Move the hand in the page; with --policy, after this policy until it is handed back.", False)
    output: Path | None = output_flag(None)
    start_from: Path | None = flag("Recording with an episode to go on from, of any policy.", None, unset="none")
    start_episode: int = flag("Number of that episode.", 0, minimum=0, maximum=MAX_COUNT)
    start_step: int | None = flag(
        "Control step to go on from.", None, minimum=0, maximum=MAX_EPISODE_STEPS, unset="the last one"
    )

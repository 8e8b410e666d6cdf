"""Settings of the commands: each field is the flag of its name, with the type and the `Flag` of its annotation.

The annotations stand first, in the order in which `--help` lists the flags. The settings of each command follow.
"""

import dataclasses
import functools
import itertools
import json
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from kitchen_suite import checks, suite

if TYPE_CHECKING:
    from kitchen_suite.workers.cluster import RaySettings

WIDTH = 100  # Characters in a line that a command prints.

_MAX_STEPS = 10**12

# Longer episodes would exceed the 512 MiB of arrays that `files.load_arrays` reads: a control step takes up to 2 KiB.
_MAX_EPISODE_STEPS = 100_000

# Size of the models' offscreen buffers [pixels].
_MAX_WIDTH, _MAX_HEIGHT = 1920, 1440

_positions = itertools.count()


@dataclasses.dataclass(frozen=True)
class Flag:
    """The help of a flag, and the values that it accepts.

    Attributes:
      help: one or two sentences, without the default.
      minimum: least value of a number.
      maximum: greatest value of a number.
      choices: values of a string; any when empty.
      unset: what applies without the flag, where it has no default. `metadata["unset"]` of a field replaces it.
      check: raises a ValueError for a value that is refused.
      position: in `--help`.
    """

    help: str
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    unset: str = ""
    check: Callable[[Any], None] = lambda value: None
    position: int = dataclasses.field(default_factory=lambda: next(_positions), init=False)


def _check_even(pixels: int) -> None:
    """Raises a ValueError for an odd number."""
    if pixels % 2:
        raise ValueError("must be even")


def _check_folder(path: Path) -> None:
    """Raises a ValueError for a path that exists and is no folder."""
    if path.exists() and not path.is_dir():
        raise ValueError("is not a folder")


def _check_file(path: Path, suffix: str = "") -> None:
    """Raises a ValueError for a path that cannot be written to as a file whose name ends with a suffix."""
    if not path.name.endswith(suffix) or (path.exists() and not path.is_file()):
        raise ValueError(f"must be a file that ends with {suffix}" if suffix else "is not a file")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise ValueError(f"there is no folder {str(path.parent)!r} that may be written to")


RecordingSource = Annotated[
    str, Flag("Recording to replay: folder of kitchen-record or kitchen-rollout, or Minari or LeRobot dataset.")
]
HumanSource = Annotated[str, Flag("Demonstrations to convert: HDF5 file of D4RL, or Minari dataset.")]
ListDomains = Annotated[bool, Flag("List all domains with their tasks and cameras, and exit.")]
ListPolicies = Annotated[bool, Flag("List the trained policies that come with the package, and exit.")]
Measure = Annotated[
    str,
    Flag(
        "speed: control steps per second as ratios; scaling: by number of environments and threads, with memory; "
        "soak: memory in the course of a long run; rendering: frames per second, and what a frame costs.",
        choices=("speed", "scaling", "soak", "rendering"),
    ),
]
ProtocolName = Annotated[
    str, Flag("Protocol of the evaluation: it sets task, variations, seeds and number of episodes.")
]
DomainName = Annotated[
    str, Flag("Domain of the task; kitchen-rollout --list shows all. module:NAME is a Domain of your own.")
]
TaskName = Annotated[
    str, Flag("Task of the domain.", unset="its first benchmark task (kitchen: complete), or its first")
]
TaskKwargs = Annotated[
    Mapping[str, Any],
    Flag("Arguments of the task's Gymnasium environment, as a JSON object such as '{\"robot_noise_ratio\": 0}'."),
]
ControlMode = Annotated[
    str,
    Flag(
        "Meaning of the action, such as joint_position or ee_delta_pose; see docs/guide/control_modes.md.",
        unset="the domain's",
    ),
]
Variations = Annotated[
    str,
    Flag(
        "Groups of parameters that vary from episode to episode, such as start,dynamics; or distributions by "
        "parameter, as a JSON object; see docs/guide/variations.md.",
        unset="none",
    ),
]
VariationSplit = Annotated[
    str, Flag("Distributions of the groups: seen, or held_out.", choices=("seen", "held_out"), unset="seen")
]
VariationValues = Annotated[
    Mapping[str, Any],
    Flag("Values of parameters that vary, in place of drawn ones, as a JSON object such as '{\"kettle/mass\": 1}'."),
]
PolicyName = Annotated[
    str,
    Flag(
        "random, zero, expert, trained, or module:callable, which takes a dm_env.TimeStep and returns the action. "
        "expert and trained take options, as in 'expert(speed=0.8)' and \"trained(file='policy.npz')\"."
    ),
]
ShippedPolicy = Annotated[str, Flag("Name of a trained policy that comes with the package.")]
PolicyFile = Annotated[Path, Flag("File of a trained policy, written by kitchen-train.")]
EpisodeNumbers = Annotated[str, Flag("Which episodes: all, or numbers and ranges such as 0,5,7-9.")]
NumEpisodes = Annotated[int, Flag("Number of episodes.", minimum=1, maximum=1_000_000)]
NumReplayed = Annotated[
    int,
    Flag("Number of episodes, spread evenly over the recording, without --episodes.", minimum=1, maximum=1_000_000),
]
Seed = Annotated[int, Flag("First seed; further episodes, or restarts of a training, have the next ones.", minimum=0)]
MaxEpisodeSteps = Annotated[
    int,
    Flag("Control steps after which an episode ends.", minimum=1, maximum=_MAX_EPISODE_STEPS, unset="the domain's"),
]
NumMeasuredSteps = Annotated[
    int,
    Flag("Control steps in total, over all environments.", minimum=0, maximum=_MAX_STEPS, unset="the measure's"),
]
NumTrainingSteps = Annotated[
    int,
    Flag(
        "Control steps in total, over all environments; training may end earlier: see --target_success.",
        minimum=0,
        maximum=_MAX_STEPS,
        unset="the domain's",
    ),
]
NumEnvs = Annotated[int, Flag("Number of environments stepped together.", minimum=1, maximum=checks.MAX_ENVS)]
NumbersOfEnvs = Annotated[
    tuple[int, ...],
    Flag(
        "Numbers of environments stepped together, such as 1,8,32.",
        minimum=1,
        maximum=checks.MAX_ENVS,
        unset="the measure's",
    ),
]
NumThreads = Annotated[
    int,
    Flag("Threads that step the environments.", minimum=1, maximum=checks.MAX_THREADS, unset="one per processor"),
]
Workers = Annotated[
    int, Flag("Processes on Ray that play the episodes; needs the extra ray.", minimum=1, maximum=10_000)
]
RayAddress = Annotated[
    str, Flag("Ray cluster of the workers: HOST:PORT, ray://HOST:PORT, or auto.", unset="started for the command")
]
Rounds = Annotated[int, Flag("Rounds that count.", minimum=1, maximum=1_000_000)]
TrainingKwargs = Annotated[
    Mapping[str, Any],
    Flag(
        "Arguments of the environments trained in, not of those evaluated in, as a JSON object; they replace the "
        "domain's."
    ),
]
HyperparameterChanges = Annotated[Mapping[str, Any], Flag("Changes to the domain's hyperparameters, as a JSON object.")]
Algorithm = Annotated[str, Flag("Algorithm: ppo, or bc, flow or vqbet, which imitate --demonstrations.")]
NumDemonstrations = Annotated[
    tuple[int, ...],
    Flag("Episodes to learn from; or a number for each folder.", minimum=1, maximum=10**9, unset="all"),
]
DemonstrationFolders = Annotated[
    tuple[Path, ...], Flag("Folders of kitchen-record, separated by commas; PPO clones them first.")
]
InitialPolicy = Annotated[Path, Flag("File of a trained policy to start from.", unset="from scratch")]
EvalInterval = Annotated[
    int,
    Flag(
        "Control steps between evaluations, each followed by a checkpoint.",
        minimum=1,
        maximum=_MAX_STEPS,
        unset="the domain's",
    ),
]
EvalEpisodes = Annotated[int, Flag("Episodes of an evaluation, on seeds held out.", minimum=1, maximum=checks.MAX_ENVS)]
TargetSuccess = Annotated[
    float,
    Flag(
        "Success rate of two evaluations in a row that ends training; above 1: never.",
        minimum=0,
        unset="the domain's",
    ),
]
Patience = Annotated[
    int,
    Flag(
        "Control steps without --min_progress after which a seed is given up; 0: never.",
        minimum=0,
        maximum=_MAX_STEPS,
        unset="the domain's",
    ),
]
MinProgress = Annotated[float, Flag("Mean opening [m], or tasks completed, that counts as progress.", minimum=0)]
Restarts = Annotated[int, Flag("Number of further seeds to try where one is given up.", minimum=0, maximum=1_000_000)]
ResumeRun = Annotated[bool, Flag("Continue the run in the folder from its newest checkpoint.")]
ResumeEvaluation = Annotated[bool, Flag("Continue the evaluation in the folder.")]
Preset = Annotated[
    str, Flag("Set of demonstrations, of its own task and policy: one of the domain's presets.", unset="none")
]
OutputFolder = Annotated[Path, Flag("Folder to write to.", check=_check_folder)]
DatasetFormat = Annotated[str, Flag("Format of the dataset: minari or lerobot.", unset="minari with --dataset")]
DatasetName = Annotated[
    str,
    Flag(
        "Name of a dataset to make of the episodes, such as kitchen-suite/complete-random-v0 (Minari) or me/kettle "
        "(LeRobot)."
    ),
]
DataPath = Annotated[Path, Flag("Folder of the datasets.", unset="Minari's or LeRobot's own")]
PrintJson = Annotated[bool, Flag("Print JSON in place of tables.")]
JsonFile = Annotated[
    Path, Flag("File to write the results to as JSON; an existing one is replaced.", check=_check_file)
]
VideoFile = Annotated[
    Path,
    Flag(
        "Video to write, an .mp4 in an existing folder; an existing video is replaced.",
        unset="none",
        check=functools.partial(_check_file, suffix=".mp4"),
    ),
]
NoVideo = Annotated[bool, Flag("Write no video.")]
VideoEpisodes = Annotated[int, Flag("Number of episodes in the video, the first ones.", minimum=1, maximum=1_000_000)]
VideoFps = Annotated[float, Flag("Maximum number of frames per second of the video.", minimum=0.1, maximum=10_000)]
Port = Annotated[int, Flag("Port of the page, on this machine alone.", minimum=1024, maximum=65535)]
WebPage = Annotated[
    Path,
    Flag(
        "Web page to write, an .html in an existing folder, which shows the episodes in 3-D; an existing page is "
        "replaced.",
        unset="none",
        check=functools.partial(_check_file, suffix=".html"),
    ),
]
WebEpisodes = Annotated[int, Flag("Number of episodes in the web page, the first ones.", minimum=1, maximum=1000)]
RenderQuality = Annotated[
    str,
    Flag(
        "high; or fast: a video without shadows, reflections, sky and multisampling, and with fewer faces.",
        choices=("high", "fast"),
    ),
]
CameraName = Annotated[str, Flag("Camera of the video and the page, by name or number.")]
Width = Annotated[int, Flag("Width of the video [pixels], even.", minimum=2, maximum=_MAX_WIDTH, check=_check_even)]
Height = Annotated[int, Flag("Height of the video [pixels], even.", minimum=2, maximum=_MAX_HEIGHT, check=_check_even)]
VisualizeReward = Annotated[bool, Flag("Colour objects in the video while they count as a success.")]


# Beginning of the names of the observation types with pictures; a GL library is chosen before these can be imported.
PICTURES_PREFIX = "pixels"


@dataclasses.dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """The task of a command."""

    domain_name: DomainName
    task_name: TaskName | None = None
    task_kwargs: TaskKwargs = dataclasses.field(default_factory=dict)
    control_mode: ControlMode | None = None
    variations: Variations | None = None
    variation_split: VariationSplit | None = None

    @property
    def environment_kwargs(self) -> dict[str, Any]:
        """Arguments of the task's Gymnasium environment.

        Raises:
          ValueError: one is given twice, with different values.
        """
        variations = None if self.variations is None else parsed_variations(self.variations)
        chosen = {"control_mode": self.control_mode, "variations": variations, "variation_split": self.variation_split}
        given = {name: value for name, value in chosen.items() if value is not None}
        for name, value in given.items():
            if (other := self.task_kwargs.get(name, value)) != value:
                raise ValueError(f"{name} is {value!r}, but {other!r} in the task_kwargs")
        return {**self.task_kwargs, **given}

    @property
    def observes_pictures(self) -> bool:
        """Whether observations hold pictures, so that playing needs a GL library."""
        return str(self.task_kwargs.get("obs_type")).startswith(PICTURES_PREFIX)


def parsed_variations(text: str) -> Any:
    """Returns what varies: a list of the names that commas separate, or the contents of a JSON object.

    Raises:
      ValueError: the text begins like a JSON object and is none.
    """
    if not text.lstrip().startswith("{"):
        return text.split(",")
    try:
        return json.loads(text)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"variations is not JSON: {error}") from error


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSettings(TaskSettings):
    """The episodes of a task that a command plays, and the processes that play them."""

    domain_name: DomainName = "kitchen"
    policy: PolicyName = "random"
    seed: Seed = 0
    max_episode_steps: MaxEpisodeSteps | None = None
    workers: Workers | None = None
    ray_address: RayAddress | None = None

    @property
    def ray(self) -> "RaySettings | None":
        """The workers that play the episodes, checked; None where the command plays them itself."""
        if self.workers is None:
            if self.ray_address:
                raise ValueError("--ray_address needs --workers: the number of processes there")
            return None
        from kitchen_suite.workers.cluster import RaySettings

        return RaySettings.of(self.workers, self.ray_address)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PageSettings:
    """The web page that a command writes."""

    web: WebPage | None = None
    web_episodes: WebEpisodes = 10
    camera: CameraName = "overview"


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmSettings(PageSettings):
    """The video and the web page that a command writes."""

    video: VideoFile | None = None
    video_fps: VideoFps = 25.0
    width: Width = 640
    height: Height = 480
    video_episodes: VideoEpisodes = 1
    render_quality: RenderQuality = "fast"

    @property
    def rendering(self) -> dict[str, Any]:
        """Arguments of the filmed environment; without pictures it is built without visuals, and steps faster."""
        return {"visuals": True if self.video or self.web else None, "render_quality": self.render_quality}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RolloutSettings(EpisodeSettings, FilmSettings):
    """Settings of `kitchen-rollout`."""

    list: ListDomains = False
    num_episodes: NumEpisodes = 3
    output: OutputFolder | None = None
    visualize_reward: VisualizeReward = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlaySettings(FilmSettings):
    """Settings of `kitchen-play`."""

    list: ListPolicies = False
    shipped: ShippedPolicy | None = None
    policy_file: PolicyFile | None = None
    num_episodes: NumEpisodes = 10
    seed: Seed = 0
    max_episode_steps: MaxEpisodeSteps | None = None
    video: VideoFile | None = dataclasses.field(
        default=None, metadata={"unset": "kitchen-play.mp4, where it can be made, without --web"}
    )
    novideo: NoVideo = False
    # Enough to follow a motion, and few enough to be rendered without a graphics card.
    video_fps: VideoFps = 12.5


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordSettings(EpisodeSettings):
    """Settings of `kitchen-record`.

    A preset sets those that have their default: task, `task_kwargs` and policy.
    """

    output: OutputFolder
    preset: Preset | None = None
    num_episodes: NumEpisodes = 100
    num_envs: NumEnvs = 16
    num_threads: NumThreads | None = None
    format: DatasetFormat | None = None
    dataset: DatasetName | None = None
    data_path: DataPath | None = None

    @property
    def resolved(self) -> "RecordSettings":
        """The settings with those of the preset; a ValueError where one of them is given another value."""
        if self.preset is None:
            return self
        presets = suite.find_domain(self.domain_name).resolve("recording") or {}
        chosen = presets[checks.choice(self.preset, presets, "preset")]
        defaults = {field.name: field.default for field in dataclasses.fields(self)} | {"task_kwargs": {}}
        if given := sorted(name for name in chosen if getattr(self, name) not in (defaults[name], chosen[name])):
            raise ValueError(f"preset {self.preset!r} fixes {', '.join(given)}: leave it out, or the preset")
        return dataclasses.replace(self, **chosen)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplaySettings(FilmSettings):
    """Settings of `kitchen-replay`; `source` is its argument."""

    source: RecordingSource
    episodes: EpisodeNumbers | None = None
    num_episodes: NumReplayed = 10
    data_path: DataPath | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConvertSettings:
    """Settings of `kitchen-convert`; `source` is its argument."""

    source: HumanSource
    output: OutputFolder
    data_path: DataPath | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchmarkSettings:
    """Settings of `kitchen-benchmark`."""

    measure: Measure = "speed"
    domain_name: DomainName = "kitchen"
    rounds: Rounds = 9
    max_episode_steps: MaxEpisodeSteps | None = None
    num_envs: NumbersOfEnvs = ()
    num_steps: NumMeasuredSteps | None = None
    json: PrintJson = False


# Metadata of a setting that replaces the protocol's value.
_PROTOCOLS = {"unset": "the protocol's"}


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluateSettings(TaskSettings, PageSettings):
    """Settings of `kitchen-evaluate`.

    Those that are None, and `task_kwargs` that are not given, are the protocol's.
    """

    protocol: ProtocolName = "default"
    domain_name: DomainName = "kitchen"
    policy: PolicyName = "random"
    task_name: TaskName | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    control_mode: ControlMode | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    variations: Variations | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    variation_split: VariationSplit | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    seed: Seed | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    num_episodes: NumEpisodes | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    max_episode_steps: MaxEpisodeSteps | None = dataclasses.field(default=None, metadata=_PROTOCOLS)
    num_envs: NumEnvs = 16
    num_threads: NumThreads | None = None
    resume: ResumeEvaluation = False
    output: OutputFolder | None = None
    json: JsonFile | None = None


# Algorithms by the name of `--algorithm`; all but the first learn from demonstrations alone.
PPO = "ppo"
ALGORITHMS = (PPO, "bc", "flow", "vqbet")

# Of imitation, in every domain.
_IMITATION = {"num_steps": 8_000, "eval_interval": 4_000, "target_success": 1.1, "patience": 0}

# Of domains without a training recipe of their own.
_TRAINING = {"num_steps": 49_000_000, "eval_interval": 500_000, "target_success": 0.99, "patience": 8_000_000}


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainSettings(TaskSettings):
    """Settings of `kitchen-train`.

    Steps are control steps over all environments, and steps of the optimiser in imitation. Those that are None are the
    domain's or the algorithm's, see `schedule`.
    """

    output: OutputFolder
    domain_name: DomainName = "open_cabinet"
    algorithm: Algorithm = PPO
    training_kwargs: TrainingKwargs = dataclasses.field(default_factory=dict)
    hyperparameters: HyperparameterChanges = dataclasses.field(default_factory=dict)
    demonstrations: DemonstrationFolders = ()
    num_demonstrations: NumDemonstrations = ()
    initial_policy: InitialPolicy | None = None
    num_steps: NumTrainingSteps | None = None
    eval_interval: EvalInterval | None = None
    eval_episodes: EvalEpisodes = 100
    target_success: TargetSuccess | None = None
    patience: Patience | None = None
    min_progress: MinProgress = 0.05
    seed: Seed = 0
    restarts: Restarts = 3
    num_threads: NumThreads | None = None
    resume: ResumeRun = False
    video: VideoFile | None = None

    @property
    def schedule(self) -> "Schedule":
        """When to evaluate and when to stop, with the domain's values for those that are None.

        Raises:
          ValueError: an unknown domain.
        """
        recipe = suite.find_domain(self.domain_name).resolve("training")
        own = _IMITATION if self.algorithm != PPO else {} if recipe is None else recipe.settings
        defaults: dict[str, Any] = {**_TRAINING, **own}
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

    output: OutputFolder
    domain_name: DomainName = "kitchen"
    seed: Seed = 0
    variation_values: VariationValues = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ViewSettings(TaskSettings):
    """Settings of `kitchen-view`."""

    domain_name: DomainName = "kitchen"
    policy: PolicyName = "random"
    seed: Seed = 0
    max_episode_steps: MaxEpisodeSteps | None = None
    camera: CameraName = "overview"
    render_quality: RenderQuality = "fast"
    port: Port = 8080

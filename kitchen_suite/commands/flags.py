"""Flags that several commands have; each function defines some of them among the flags of one command."""

import functools
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from absl import flags

from kitchen_suite import checks, files, imports
from kitchen_suite.physics_names import PHYSICS
from kitchen_suite.rendering import gl

if TYPE_CHECKING:
    from kitchen_suite.episodes.cluster import Cluster
    from kitchen_suite.episodes.spec import EnvironmentSpec

# Size of the models' offscreen buffers [pixels].
_MAX_WIDTH = 1920
_MAX_HEIGHT = 1440

# Flags that are arguments of the task's Gymnasium environment, beside `task_kwargs`.
_ENVIRONMENT_FLAGS = (
    "physics",
    "obs_type",
    "control_mode",
    "control_timestep",
    "variations",
    "variation_split",
    "quality",
)


class PathParser(flags.ArgumentParser[Path]):
    """Parses a path, which a function may refuse by a ValueError."""

    syntactic_help = ""

    def __init__(self, check: Callable[[Path], None] = lambda path: None) -> None:
        self._check = check

    def parse(self, argument: str | Path) -> Path:
        if not str(argument):
            raise ValueError("it is empty")
        path = Path(argument)
        self._check(path)
        return path

    def flag_type(self) -> str:
        return "path"


class JsonParser(flags.ArgumentParser[dict[str, Any]]):
    """Parses a JSON object."""

    syntactic_help = "a JSON object"

    def parse(self, argument: str | dict[str, Any]) -> dict[str, Any]:
        if isinstance(argument, dict):  # A default.
            return dict(argument)
        try:
            value = files.parse_json(argument)
        except ValueError as error:
            hint = f'; for the JSON in that file write "$(cat {argument})"' if argument.endswith(".json") else ""
            raise ValueError(f"it cannot be read as JSON: {error}{hint}") from error
        if not isinstance(value, dict):
            raise ValueError("it must be a JSON object")
        return value

    def flag_type(self) -> str:
        return "JSON object"


class FloatParser(flags.FloatParser):
    """Parses a finite number."""

    def convert(self, argument: Any) -> float:
        value = super().convert(argument)
        if not math.isfinite(value):
            raise ValueError("it must be finite")
        return value


def check_folder(path: Path) -> None:
    """Raises a ValueError for a path that exists and is no folder."""
    if path.exists() and not path.is_dir():
        raise ValueError("it is not a folder")


def check_file(path: Path, suffix: str = "") -> None:
    """Raises a ValueError for a path that cannot be written to as a file whose name ends with a suffix."""
    if not path.name.endswith(suffix) or (path.exists() and not path.is_file()):
        raise ValueError(f"it must be a file that ends with {suffix}" if suffix else "it is not a file")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise ValueError(f"there is no folder {str(path.parent)!r} that may be written to")


def folder(values: flags.FlagValues, name: str, help: str, *, required: bool = False) -> None:
    """Defines the path of a folder, which need not exist."""
    flags.DEFINE(PathParser(check_folder), name, None, help, values)
    if required:
        flags.mark_flag_as_required(name, values)


def file(values: flags.FlagValues, name: str, help: str, *, suffix: str = "") -> None:
    """Defines the path of a file to write."""
    flags.DEFINE(PathParser(functools.partial(check_file, suffix=suffix)), name, None, help, values)


def path(values: flags.FlagValues, name: str, help: str) -> None:
    """Defines the path of something to read."""
    flags.DEFINE(PathParser(), name, None, help, values)


def json_object(values: flags.FlagValues, name: str, help: str) -> None:
    """Defines a JSON object, empty by default."""
    flags.DEFINE(JsonParser(), name, {}, help, values)


def number(
    values: flags.FlagValues,
    name: str,
    default: float | None,
    help: str,
    *,
    minimum: float,
    maximum: float | None = None,
) -> None:
    """Defines a finite number."""
    flags.DEFINE(FloatParser(minimum, maximum), name, default, help, values)


def output(values: flags.FlagValues, *, required: bool = False) -> None:
    """Defines the folder that a command writes to."""
    folder(values, "output", "Folder to write to.", required=required)


def task(
    values: flags.FlagValues, *, unset: str = "the domain's", task_unset: str = "its first benchmark task"
) -> None:
    """Defines which task is done, and the arguments of its environment; `unset` says what applies without a flag."""
    domains = "kitchen, kitchens (generated ones) or another of kitchen-rollout --list; module:NAME is a custom one"
    flags.DEFINE_string("domain_name", "kitchen", f"Domain: {domains}.", values)
    tasks = f"Task of the domain; all, in the kitchen, is seven of its twenty; without the flag {task_unset}."
    flags.DEFINE_string("task_name", None, tasks, values)
    example = "'{\"robot_noise_ratio\": 0}'"
    json_object(values, "task_kwargs", f"Arguments of the task's Gymnasium environment, such as {example}.")
    flags.DEFINE_enum("physics", None, PHYSICS, f"exact, or fast: longer steps, for training; else {unset}.", values)
    types = "Observation type, such as state or pixels_agent_pos (docs/guide/observations.md)"
    flags.DEFINE_string("obs_type", None, f"{types}; else {unset}.", values)
    modes = "Meaning of the action, such as joint_position or ee_delta_pose (docs/guide/control_modes.md)"
    flags.DEFINE_string("control_mode", None, f"{modes}; else {unset}.", values)
    step = f"Length of a control step [s], a whole number of physics steps; else {unset}."
    number(values, "control_timestep", None, step, minimum=0)
    groups = (
        "Groups of parameters that vary from episode to episode, such as start,dynamics; none; or distributions by "
        "parameter, as a JSON object (docs/guide/variations.md)"
    )
    flags.DEFINE_string("variations", None, f"{groups}; else {unset}.", values)
    splits = ("seen", "held_out")
    flags.DEFINE_enum("variation_split", None, splits, f"Distributions of the groups; else {unset}.", values)
    quality = "Measure forces, disturbed objects, energy and smoothness (docs/guide/quality.md)"
    flags.DEFINE_boolean("quality", None, f"{quality}; else {unset}.", values)


def environment_kwargs(given: flags.FlagValues) -> dict[str, Any]:
    """Returns the arguments of the task's Gymnasium environment that are given; raises as `merged_kwargs`."""
    from kitchen_suite.episodes.spec import merged_kwargs

    return merged_kwargs(given.task_kwargs, {name: given[name].value for name in _ENVIRONMENT_FLAGS})


def custom(values: flags.FlagValues) -> None:
    """Defines the code of a user's own that files may name."""
    text = "Domains and robots of your own, as module:NAME and separated by commas, that the files may name."
    flags.DEFINE_list("custom", [], text, values)


def import_custom(given: flags.FlagValues, *others: object) -> None:
    """Imports what `custom` names, and those of some `others` that are `module:NAME`, so that files may name it."""
    for name in (*given.custom, *others):
        if isinstance(name, str) and ":" in name:
            imports.named(name, "custom")


def policy(values: flags.FlagValues, *, default: str | None = "random") -> None:
    """Defines the policy that acts."""
    forms = (
        "random, zero, expert, trained, a file such as policy.npz, ws://host:port; module:callable, of a "
        "dm_env.TimeStep; or gym:module:callable, of Gymnasium's observation. Options as in 'expert(speed=0.8)'."
    )
    flags.DEFINE_string("policy", default, f"Policy: {forms}", values)


def seed(values: flags.FlagValues, *, default: int | None = 0, unset: str = "") -> None:
    """Defines the first seed."""
    end = f"; else {unset}" if unset else ""
    flags.DEFINE_integer("seed", default, f"First seed; later episodes have the next ones{end}.", 0, flag_values=values)


def num_episodes(values: flags.FlagValues, default: int | None, *, unset: str = "") -> None:
    """Defines the number of episodes."""
    text = f"Number of episodes; else {unset}." if unset else "Number of episodes."
    flags.DEFINE_integer("num_episodes", default, text, 1, checks.MAX_COUNT, flag_values=values)


def max_episode_steps(values: flags.FlagValues, *, unset: str = "the domain's") -> None:
    """Defines the length of episodes."""
    text = f"Control steps after which an episode ends; else {unset}."
    flags.DEFINE_integer("max_episode_steps", None, text, 1, checks.MAX_EPISODE_STEPS, flag_values=values)


def num_envs(values: flags.FlagValues, default: int = 16) -> None:
    """Defines how many environments are stepped together, and by how many threads."""
    text = "Number of environments stepped together."
    flags.DEFINE_integer("num_envs", default, text, 1, checks.MAX_ENVS, flag_values=values)
    num_threads(values)


def num_threads(values: flags.FlagValues) -> None:
    """Defines the number of threads that step environments."""
    text = "Threads that step the environments; else one per processor."
    flags.DEFINE_integer("num_threads", None, text, 1, checks.MAX_THREADS, flag_values=values)


def cluster(values: flags.FlagValues) -> None:
    """Defines the Ray cluster on which episodes are played."""
    text = "Processes on Ray that play the episodes, which need the extra ray; else this process alone."
    flags.DEFINE_integer("workers", None, text, 1, 10_000, flag_values=values)
    address = "Ray cluster of the workers: HOST:PORT, ray://HOST:PORT, or auto; else one is started for the command."
    flags.DEFINE_string("ray_address", None, address, values)
    text = "Processors that each worker reserves with Ray, such as 0.5; else one for each of its threads."
    number(values, "cpus_per_worker", None, text, minimum=0.01, maximum=checks.MAX_THREADS)


def page(values: flags.FlagValues) -> None:
    """Defines the web page of the episodes."""
    text = "Web page to write, an .html in an existing folder, which shows the episodes in 3-D; it may be replaced."
    file(values, "web", text, suffix=".html")
    count = "Number of episodes in the web page, the first ones."
    flags.DEFINE_integer("web_episodes", 10, count, 1, 1000, flag_values=values)
    flags.DEFINE_string("camera", "overview", "Camera of the video and the page, by name or number.", values)


def table_format(values: flags.FlagValues) -> None:
    """Defines the format of the tables that are printed."""
    text = "Format of the printed tables: text, markdown, or latex, which needs the package booktabs."
    flags.DEFINE_enum("format", "text", ("text", "markdown", "latex"), text, values)


def video(
    values: flags.FlagValues, *, fps: float = 25.0, unset: str = "none", width: int = 640, num_episodes: int = 1
) -> None:
    """Defines the video of the episodes."""
    text = f"Video to write, an .mp4 in an existing folder, which may be replaced; else {unset}."
    file(values, "video", text, suffix=".mp4")
    number(values, "video_fps", fps, "Maximum number of frames per second of the video.", minimum=0.1, maximum=10_000)
    for name, default, most in (("width", width, _MAX_WIDTH), ("height", 480, _MAX_HEIGHT)):
        size = f"{name.capitalize()} of the video [pixels], even."
        flags.DEFINE_integer(name, default, size, 2, most, flag_values=values)
        flags.register_validator(name, lambda pixels: pixels % 2 == 0, f"{name} must be even", values)
    count = "Number of episodes in the video, the first ones."
    flags.DEFINE_integer("video_episodes", num_episodes, count, 1, checks.MAX_COUNT, flag_values=values)
    render_quality(values)


def render_quality(values: flags.FlagValues) -> None:
    """Defines how images are rendered."""
    text = "high; or fast: images without shadows, reflections, sky and multisampling, and with fewer faces."
    flags.DEFINE_enum("render_quality", "fast", ("high", "fast"), text, values)


def integers(texts: Sequence[str], name: str) -> list[int]:
    """Returns the numbers of a flag whose value is a list; raises a ValueError unless all are positive."""
    try:
        numbers = [int(text) for text in texts]
    except ValueError as error:
        shown = checks.shown(",".join(texts))
        raise ValueError(f"{name} must be integers that commas separate, got {shown}") from error
    if numbers and min(numbers) < 1:
        raise ValueError(f"{name} must be at least 1, got {min(numbers)}")
    return numbers


def prepare_images(spec: "EnvironmentSpec", *, rendering: bool = False) -> None:
    """Raises an OSError if images will be rendered, in observations or otherwise, but no GL library works here."""
    if rendering or spec.observes_images:
        gl.prepare(rendering=True)


def make_cluster(given: flags.FlagValues) -> "Cluster | None":
    """Returns the Ray workers that play the episodes, None where this process does; raises as `Cluster`."""
    from kitchen_suite.episodes.cluster import Cluster

    if given.workers is None:
        for name in ("ray_address", "cpus_per_worker"):
            if given[name].value is not None:
                raise ValueError(f"{name} needs the number of workers there")
        return None
    return Cluster(given.workers, given.ray_address, given.cpus_per_worker)

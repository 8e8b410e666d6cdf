"""The record of a domain, and what the builders of all domains share."""

import dataclasses
import math
import re
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from kitchen_suite import checks

if TYPE_CHECKING:
    from kitchen_suite.environment import Environment
    from kitchen_suite.tasks.task import SuiteTask

# Arguments of tasks that the builders set.
SET_BY_BUILDERS = ("scene",)

# Arguments of the Gymnasium environments on which the meaning of the action depends, in every domain.
CONTROL_OPTIONS = ("control_mode", "linear_speed", "angular_speed", "joint_speed", "frame")

# Arguments of `Environment` that the builders set.
_SET_OF_ENVIRONMENT = ("task", "time_limit", "random_state")

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_ENV_ID = re.compile(r"[\w.-]+/[\w.-]+-v\d+")
_ENTRY_POINT = re.compile(r"\w+(\.\w+)*:\w+")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Domain:
    """A domain of the suite.

    What would import much is named by entry points, strings `module:name`. Options are arguments of the Gymnasium
    environment.

    Attributes:
      name: as `suite.load` takes it.
      build: builds an environment for `suite.load`, from arguments of `tasks` and those that the caller adds.
      tasks: by task name, the arguments that define the task: of `build` and of the Gymnasium environments.
      env_id: id of the Gymnasium environment for any of the tasks, such as `KitchenSuite/FrankaKitchen-v1`.
      env: entry point of its class, a `SuiteEnv`.
      vector_env: entry point of the class of the vectorised environment, a `SuiteVectorEnv`.
      episode_steps: control steps in an episode.
      task_id: id of a task's Gymnasium environment, with `{}` for the name of the task in camel case; by default the
        `env_id` with that name before its version.
      benchmark_tasks: names of the tasks that papers report; the first is the default task. Without any, the default is
        the first of `tasks`.
      replaceable: arguments of `tasks` that a caller may replace.
      array_options: options with which infos are arrays of fixed shape alone, which can be recorded.
      flat_options: options with which goals are arrays as well, as a network needs them.
      state_options: names of the options on which the meaning of actions and of observed states depends.
      cloning_options: names of those on which the meaning of whole observations, with their goals, and of actions
        depends. Demonstrations can be cloned where these are equal.
      hyperparameters: values that replace defaults of `training.hyperparameters.Hyperparameters`.
      cloning_hyperparameters: values that replace these where demonstrations are cloned first.
      training_options: options of the environments that policies are trained in from scratch, which those that they are
        evaluated in do not have; except for `max_episode_steps`, which both have.
      training_settings: values that replace defaults of `settings.TrainSettings`, those of `num_steps`,
        `eval_interval`, `target_success` and `patience`.
      recording_presets: settings of `kitchen-record` by the name of a set of demonstrations: `task_name`, `task_kwargs`
        and `policy`.
      evaluation_task: name of the task that `kitchen-evaluate` plays where its protocol names none; the default task
        when empty.
      protocols: names of the protocols of `kitchen-evaluate` that are made for this domain, beside those for all.
      expert: entry point of the class of the scripted expert, a `policies.experts.Expert`; None if there is none.
      benchmark: entry point of the `benchmarks.cases.BenchmarkDomain`; None if there is none.
    """

    name: str
    build: "Callable[..., Environment]"
    tasks: Mapping[str, Mapping[str, Any]]
    env_id: str
    env: str
    vector_env: str
    episode_steps: int
    task_id: str = ""
    benchmark_tasks: Collection[str] = ()
    replaceable: Collection[str] = ()
    array_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    flat_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    state_options: Collection[str] = ()
    cloning_options: Collection[str] = ()
    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    cloning_hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    training_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    training_settings: Mapping[str, float] = dataclasses.field(default_factory=dict)
    recording_presets: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    evaluation_task: str = ""
    protocols: Collection[str] = ()
    expert: str | None = None
    benchmark: str | None = None

    def __post_init__(self) -> None:
        """Checks the record.

        Raises:
          TypeError: an attribute has the wrong type.
          ValueError: there are no tasks, or a name, an id or an entry point is not well-formed.
        """
        if not callable(self.build):
            raise TypeError(f"build must be a function, got {self.build!r}")
        if not isinstance(self.tasks, Mapping) or not all(isinstance(each, Mapping) for each in self.tasks.values()):
            raise TypeError(f"tasks must be a dict of dicts, got {self.tasks!r}")
        if not self.tasks:
            raise ValueError(f"domain {self.name!r} has no tasks; name at least one")
        _check_form(self.name, _NAME, "name of a domain")
        for task in self.tasks:
            _check_form(task, _NAME, "name of a task")
        for env_id in (self.env_id, *self.task_ids.values()):
            _check_form(env_id, _ENV_ID, "id of an environment")
        if len({self.env_id, *self.task_ids.values()}) <= len(self.tasks):
            raise ValueError(f"task_id {self.task_id!r} must give each task an id of its own; put {{}} for its name")
        for entry_point in (self.env, self.vector_env, self.expert, self.benchmark):
            if entry_point is not None:
                _check_form(entry_point, _ENTRY_POINT, "entry point")
        checks.integer(self.episode_steps, "episode_steps", minimum=1)
        for task in self.benchmark_tasks:
            checks.choice(task, self.tasks.keys(), "benchmark task")
        if self.evaluation_task:
            checks.choice(self.evaluation_task, self.tasks.keys(), "evaluation task")

    @property
    def task_ids(self) -> dict[str, str]:
        """Ids of the Gymnasium environments of single tasks, by task name."""
        stem, _, version = self.env_id.rpartition("-")
        template = self.task_id or f"{stem}{{}}-{version}"
        return {task: template.replace("{}", task.title().replace("_", "")) for task in self.tasks}

    @property
    def default_task(self) -> str:
        """Name of the task where none is asked for."""
        return next(iter((*self.benchmark_tasks, *self.tasks)))


def _check_form(text: object, form: re.Pattern[str], what: str) -> None:
    """Raises a TypeError or ValueError unless `text` is a string that matches `form` as a whole."""
    if not isinstance(text, str):
        raise TypeError(f"{what} must be a string, got {text!r}")
    if not form.fullmatch(text):
        raise ValueError(f"{what} {text!r} is not well-formed; it must match {form.pattern}")


def check_task_options(
    options: Mapping[str, Any],
    builder: Callable[..., Any],
    task: "type[SuiteTask]",
    modes: Mapping[str, Callable[..., Any]],
) -> None:
    """Checks that a builder, its task, the base of all tasks or a control mode has keyword arguments of given names.

    Raises:
      TypeError: there is no such argument.
    """
    from kitchen_suite.tasks.observables import Pictures
    from kitchen_suite.tasks.task import SuiteTask

    takers: list[Callable[..., Any]] = [builder, task, SuiteTask, Pictures.build, *modes.values()]
    checks.keywords(options, *takers, what="argument", exclude=(*SET_BY_BUILDERS, "root"))


def checked_visuals(visuals: object, task_options: Mapping[str, Any]) -> bool:
    """Returns `visuals` if it is a bool, and not False where the task observes pictures.

    Raises:
      TypeError: it is no bool.
      ValueError: pictures need visuals.
    """
    if not checks.boolean(visuals, "visuals") and task_options.get("cameras"):
        raise ValueError("visuals=False leaves out what pictures show: leave out cameras, or visuals=False")
    return bool(visuals)


def build_environment(
    task: "SuiteTask",
    *,
    time_limit: float | None,
    random: int | np.random.RandomState | None,
    render_quality: str,
    environment_kwargs: Mapping[str, Any] | None,
) -> "Environment":
    """Builds the environment of a task.

    Args:
      task: in a scene of its own.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling, and with fewer
        faces; see `rendering.quality.set_render_quality`.
      environment_kwargs: further arguments of `Environment`.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: an unknown render quality, or the time limit is not positive and finite.
    """
    from kitchen_suite.entities.assets import is_visual
    from kitchen_suite.environment import Environment
    from kitchen_suite.rendering.quality import set_render_quality

    limit = math.inf if time_limit is None else checks.number(time_limit, "time_limit", positive=True)
    takers = Environment, *Environment.__bases__
    checks.keywords(environment_kwargs or {}, *takers, what="environment argument", exclude=_SET_OF_ENVIRONMENT)
    set_render_quality(task.root_entity.mjcf_model, render_quality, is_visual)
    settings = {
        "strip_singleton_obs_buffer_dim": True,
        "recompile_mjcf_every_episode": False,
        **(environment_kwargs or {}),
    }
    return Environment(task, time_limit=limit, random_state=random, **settings)

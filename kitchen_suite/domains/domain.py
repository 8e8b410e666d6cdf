"""The record of a domain, which builds its environments."""

import contextlib
import copy
import dataclasses
import math
import pkgutil
import re
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from kitchen_suite import checks, signatures
from kitchen_suite.domains.argument_hints import GYMNASIUM_ONLY
from kitchen_suite.domains.arguments import Argument, table
from kitchen_suite.physics_names import EXACT, FAST, PHYSICS

if TYPE_CHECKING:
    from kitchen_suite.entities import Scene
    from kitchen_suite.environment import Environment
    from kitchen_suite.tasks import SuiteTask
    from kitchen_suite.tasks.settings import Settings

# Arguments of tasks that only observations depend on: states of environments with others of these fit as well.
_OF_OBSERVATIONS = {"cameras", "depth", "extra_observables", "image_size", "segmentation"}

# Arguments that count as omitted where they are None, as in Gymnasium's environments.
_OMITTED = {"cameras", "control_mode", "depth", "segmentation"}

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_ENV_ID = re.compile(r"[\w.-]+/[\w.-]+-v\d+")
_ENTRY_POINT = re.compile(r"\w+(\.\w+)*:\w+")


@dataclasses.dataclass(frozen=True)
class Domain:
    """A domain of the suite: a scene, a task in it, and the arguments that make named tasks of it.

    A user's domain needs no more than `name` to `episode_steps`. Entry points are strings `module:name`, which are
    imported when they are used.

    Attributes:
      name: as `suite.load` takes it.
      scene: function that builds the scene, or its entry point. If it has an argument `visuals`, it is told whether
        there are pictures to render.
      task: class of the task, a `SuiteTask` that takes the scene, or its entry point.
      tasks: by task name, the arguments of scene and task that define it.
      env_id: id of the Gymnasium environment for any of the tasks, such as `KitchenSuite/FrankaKitchen-v1`. Without
        arguments it is the only task of the domain or, where there are several, has the default arguments of the class.
      episode_steps: control steps in an episode.
      task_id: id of a task's Gymnasium environment, with `{}` for the name of the task in camel case; by default the
        `env_id` with that name before its version.
      benchmark_tasks: names of the tasks that papers report; the first is the default task. Without any, the default is
        the first of `tasks`.
      replaceable: arguments of `tasks` that a caller may replace.
      physics: of its environments by default, one of `physics_names.PHYSICS`.
      env: entry point of the class of the Gymnasium environment; that of the task's `environment_classes` when omitted.
      vector_env: entry point of the class of the vectorised environment; its default is the task's as well.
      training: entry point of the `training.recipes.Recipe`; None for the general defaults.
      recording: entry point of the presets of `kitchen-record`: by name, the settings that they fix.
      evaluation: entry point of the `evaluation.protocols.DomainProtocols`; None for the general protocols alone.
      expert: entry point of the class of the scripted expert, a `policies.experts.Expert`; None if there is none.
      undirected: entry point of the class of the expert that completes tasks in a random order; None if there is none.
      measures: infos that only the domain has, and whose values at the end of an episode are measures of it in
        evaluations with `quality`, with their least possible values.
      contents: entry point of a function of the arguments of an environment that returns them with the contents of
        files in place of their names; None where no argument names a file.
    """

    name: str
    _: dataclasses.KW_ONLY
    scene: "str | Callable[..., Scene]"
    task: "str | Callable[..., SuiteTask]"
    tasks: Mapping[str, Mapping[str, Any]]
    env_id: str
    episode_steps: int
    task_id: str = ""
    benchmark_tasks: Collection[str] = ()
    replaceable: Collection[str] = ()
    physics: str = EXACT
    env: str | None = None
    vector_env: str | None = None
    training: str | None = None
    recording: str | None = None
    evaluation: str | None = None
    expert: str | None = None
    undirected: str | None = None
    measures: Mapping[str, float] = dataclasses.field(default_factory=dict)
    contents: str | None = None

    def __post_init__(self) -> None:
        """Checks the record; raises a TypeError or ValueError that names the attribute."""
        if not isinstance(self.tasks, Mapping) or not all(isinstance(each, Mapping) for each in self.tasks.values()):
            raise TypeError(f"tasks must be a dict of dicts, got {checks.shown(self.tasks)}")
        if not self.tasks:
            raise ValueError(f"domain {self.name!r} has no tasks; name at least one")
        _check_form(self.name, _NAME, "name of a domain")
        for task in self.tasks:
            _check_form(task, _NAME, "name of a task")
        _check_form(self.env_id, _ENV_ID, "id of an environment")
        _check_form(self.task_id, re.compile(".*"), "task_id")
        checks.choice(self.physics, PHYSICS, "physics")
        for env_id in self.task_ids.values():
            _check_form(env_id, _ENV_ID, "id of an environment")
        if len({self.env_id, *self.task_ids.values()}) <= len(self.tasks):
            raise ValueError(f"task_id {self.task_id!r} must give each task an id of its own; put {{}} for its name")
        for kind in ("env", "vector_env", "training", "recording", "evaluation", "expert", "undirected", "contents"):
            if (entry_point := getattr(self, kind)) is not None:
                _check_form(entry_point, _ENTRY_POINT, f"entry point {kind}")
        for kind in ("scene", "task"):
            if not callable(getattr(self, kind)):
                _check_form(getattr(self, kind), _ENTRY_POINT, f"{kind}, unless a function or class,")
        checks.integer(self.episode_steps, "episode_steps", minimum=1)
        if not isinstance(self.measures, Mapping):
            raise TypeError(f"measures must be a dict of least values by name, got {checks.shown(self.measures)}")
        for name, least in self.measures.items():
            if isinstance(least, bool) or not isinstance(least, int | float) or math.isnan(least):
                raise TypeError(f"measures[{name!r}] must be a number or -inf, got {checks.shown(least)}")
        for task in self.benchmark_tasks:
            checks.choice(task, self.tasks.keys(), "benchmark task")

    def __reduce__(self) -> tuple[Any, ...]:
        # Read-only mappings, as `tasks` of the suite's own domains, cannot be pickled.
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        tasks = {name: dict(each) for name, each in self.tasks.items()}
        return _unpickled, ({**fields, "tasks": tasks, "measures": dict(self.measures)},)

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

    def resolve(self, attribute: str) -> Any:
        """Returns the object that an attribute names by its entry point, or is itself; None for None."""
        value = getattr(self, attribute)
        return pkgutil.resolve_name(value) if isinstance(value, str) else value

    def with_contents(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Returns arguments of an environment with the contents of files in place of their names.

        Environments that are built of them later, on any machine, are the same whatever has become of the files.
        """
        read = self.resolve("contents")
        return dict(arguments) if read is None else read(arguments)

    @property
    def env_entry_point(self) -> str:
        """Entry point of the class of the Gymnasium environment."""
        return self.env or self.resolve("task").environment_classes.single

    @property
    def vector_env_entry_point(self) -> str:
        """Entry point of the class of the vectorised environment."""
        return self.vector_env or self.resolve("task").environment_classes.vector

    @property
    def env_class(self) -> type[Any]:
        """Class of the Gymnasium environment, a `SuiteEnv`."""
        return pkgutil.resolve_name(self.env_entry_point)

    @property
    def vector_env_class(self) -> type[Any]:
        """Class of the vectorised environment, a `SuiteVectorEnv`."""
        return pkgutil.resolve_name(self.vector_env_entry_point)

    def arguments(self, *environments: Callable[..., Any]) -> Mapping[str, Argument]:
        """Returns the arguments of `load`, or of the classes of other environments of the domain, by name."""
        return table(self.resolve("scene"), self.resolve("task"), *(environments or (Domain.load,)))

    @property
    def control_options(self) -> tuple[str, ...]:
        """Names of the arguments on which the meaning of the action depends: of control mode and control step."""
        of_modes = (name for name, argument in self.arguments().items() if argument.owner == "control")
        return ("control_mode", *of_modes, "control_timestep")

    def load(
        self,
        *,
        time_limit: float | Literal["default"] | None = "default",
        random: int | np.random.RandomState | None = None,
        episode_seeds: bool | int = False,
        visuals: bool | None = True,
        render_quality: str | None = "high",
        physics: str | None = None,
        control_timestep: float | None = None,
        quality: bool = False,
        environment_kwargs: Mapping[str, Any] | None = None,
        **arguments: Any,
    ) -> "Environment":
        """Builds an environment of the domain.

        Without arguments of the task it has those of its class: the kitchen then asks for the seven tasks of
        FrankaKitchen-v1, and the open cabinet for its top drawer. `suite.load` builds a task by its name.

        Args:
          time_limit: length of an episode [s]; None for no limit; by default that of `episode_steps`.
          random: seed, or random state to draw from.
          episode_seeds: whether each episode has a seed of its own, from `random` on; see `Environment`.
          visuals: False omits geoms and textures that only rendering needs; trajectories are the same to the bit.
            None is True.
          render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling, and with fewer
            faces; see `rendering.quality.set_render_quality`. None is `fast`, without a warning where the packages for
            light meshes are missing.
          physics: `exact`, or `fast`: another integration of the same model; see docs/guide/fast_physics.md. The
            domain's when omitted.
          control_timestep: length of a control step [s], a whole number of physics steps; the domain's when omitted.
            The default `time_limit` stays as many control steps.
          quality: whether the task measures how well episodes are done, as its `quality`; see docs/guide/quality.md.
          environment_kwargs: additional arguments of `kitchen_suite.environment.Environment`, such as
            `flat_observation`.
          **arguments: of the functions `scene` and `task`; docs/guide/arguments.md lists those of each domain. None
            stands for the default of `control_mode`, `cameras`, `depth` and `segmentation`.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        from kitchen_suite.environment import Environment, Origin
        from kitchen_suite.tasks.settings import Settings

        known = self.arguments()
        checks.keywords(arguments, known, what="argument", hints=GYMNASIUM_ONLY)
        arguments = self.with_contents(arguments)
        arguments = {name: value for name, value in arguments.items() if value is not None or name not in _OMITTED}
        settings = Settings(
            visuals=True if visuals is None else visuals,
            render_quality=render_quality,
            physics=self.physics if physics is None else physics,
            control_timestep=control_timestep,
            quality=quality,
            episode_seeds=episode_seeds,
        )
        of_environment = environment_kwargs or {}
        settings.check_beside(arguments, of_environment)
        of_scene = {name for name, argument in known.items() if argument.owner == "scene"}
        # A scene without an argument `visuals` is always built with what pictures show.
        shared = {"visuals": settings.visuals, **arguments}
        scene = self._make_scene(settings, {name: value for name, value in shared.items() if name in of_scene})
        of_task = {name: value for name, value in arguments.items() if name not in of_scene}
        task = self.resolve("task")(scene, **of_task)
        task.configure(settings)
        limit = self.episode_steps * task.control_timestep if time_limit == "default" else time_limit
        limit = math.inf if limit is None else checks.number(limit, "time_limit", positive=True)
        names = {*signatures.names(Environment, *Environment.__bases__)} - {"task", "time_limit", "random_state"}
        checks.keywords(of_environment, names, what="environment argument")
        if settings.render_quality != "high":
            from kitchen_suite.entities.assets import is_visual
            from kitchen_suite.rendering.quality import set_render_quality

            is_asked_for = settings.render_quality is not None
            chosen = "fast" if settings.render_quality is None else settings.render_quality
            set_render_quality(task.root_entity.mjcf_model, chosen, is_visual, warn=is_asked_for)
        options: dict[str, Any] = {
            "strip_singleton_obs_buffer_dim": True,
            "recompile_mjcf_every_episode": False,
            "episode_seeds": settings.episode_seeds,
            **of_environment,
        }
        environment = Environment(task, time_limit=limit, random_state=random, **options)
        built = {name: arguments.get(name, argument.default) for name, argument in known.items()}
        environment.keep_arguments(
            scene={name: built[name] for name in sorted(of_scene - {"visuals"})},
            # Those of the control mode are known to the task, with their defaults.
            task={
                name: value
                for name, value in built.items()
                if known[name].owner == "task" and name not in _OF_OBSERVATIONS
            },
        )
        again = {"time_limit": time_limit, "environment_kwargs": environment_kwargs, **vars(settings), **arguments}
        # A user's own task may take what cannot be copied, such as a lock; then the environment cannot, either.
        with contextlib.suppress(Exception):
            environment.origin = Origin(self.load, copy.deepcopy(again))
        return environment

    def _make_scene(self, settings: "Settings", arguments: Mapping[str, Any]) -> "Scene":
        """Returns the scene for arguments of its own, in the physics of the settings; a ValueError if it has none."""
        scene: Scene = self.resolve("scene")(**arguments)
        if settings.physics == FAST and not scene.has_fast_physics:
            robot = f" with robot {scene.robot.specification.name!r}" if "robot" in arguments else ""
            raise ValueError(f"{self.name} has no {FAST} physics{robot}: leave out physics")
        scene.use_physics(settings.physics)
        return scene


def _unpickled(fields: Mapping[str, Any]) -> Domain:
    return Domain(**fields)


def _check_form(text: object, form: re.Pattern[str], what: str) -> None:
    if not isinstance(text, str):
        raise TypeError(f"{what} must be a string, got {checks.shown(text)}")
    if not form.fullmatch(text):
        raise ValueError(f"{what} {checks.shown(text)} is not well-formed; it must match {form.pattern}")

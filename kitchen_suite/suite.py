"""The domains and tasks of the suite, and `load`, with the interface of `dm_control.suite`.

Importing this module does not import dm_control: the builders do, when they are called.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from kitchen_suite import checks

if TYPE_CHECKING:
    from kitchen_suite.entities import CabinetConfig
    from kitchen_suite.environment import Environment
    from kitchen_suite.tasks.base import SuiteTask

__all__ = [
    "ALL_TASKS",
    "BENCHMARKING",
    "DOMAINS",
    "TASKS_BY_DOMAIN",
    "Domain",
    "default_task",
    "kitchen",
    "load",
    "open_cabinet",
    "task_arguments",
]

# Arguments of tasks that the builders set.
_SET_BY_BUILDERS = ("scene",)

# Arguments of `Environment` that the builders set.
_SET_OF_ENVIRONMENT = ("task", "time_limit", "random_state")


def kitchen(
    *,
    tasks_to_complete: Sequence[str],
    time_limit: float | None = 22.4,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    render_quality: str = "high",
    sleep: bool = False,
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> "Environment":
    """Builds a kitchen environment.

    Args:
      tasks_to_complete: names of the tasks, spelt as in `tasks.GOALS`.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling.
      sleep: whether MuJoCo may put resting objects to sleep: faster, but trajectories are only nearly the same; see
        `build_kitchen_scene`.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `KitchenTask`.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `KitchenTask`; or the time limit is not positive and finite.
    """
    from kitchen_suite.entities import build_kitchen_scene
    from kitchen_suite.rendering.quality import set_render_quality
    from kitchen_suite.tasks import KitchenTask

    checks.keywords(task_options, kitchen, KitchenTask, what="argument", exclude=_SET_BY_BUILDERS)
    limit = _limit(time_limit)
    scene = build_kitchen_scene(visuals=checks.boolean(visuals, "visuals"), sleep=checks.boolean(sleep, "sleep"))
    task = KitchenTask(scene, tasks_to_complete=tasks_to_complete, **task_options)
    set_render_quality(task.root_entity.mjcf_model, render_quality)
    return _environment(task, limit, random, environment_kwargs)


def open_cabinet(
    *,
    drawer: str,
    time_limit: float | None = 7.0,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    render_quality: str = "high",
    cabinet_config: "CabinetConfig | None" = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> "Environment":
    """Builds an environment of a cabinet whose drawer is to be opened.

    Args:
      drawer: `top` or `bottom`.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling.
      cabinet_config: dimensions and joint resistances of the cabinet; the default cabinet when omitted.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `OpenCabinetTask`.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `OpenCabinetTask`; or the time limit is not positive and finite.
    """
    from kitchen_suite.entities import CabinetConfig, build_open_cabinet_scene
    from kitchen_suite.rendering.quality import set_render_quality
    from kitchen_suite.tasks import OpenCabinetTask

    checks.keywords(task_options, open_cabinet, OpenCabinetTask, what="argument", exclude=_SET_BY_BUILDERS)
    limit = _limit(time_limit)
    if not isinstance(cabinet_config, CabinetConfig | None):
        raise TypeError(f"cabinet_config must be a CabinetConfig, got {cabinet_config!r}")
    scene = build_open_cabinet_scene(cabinet_config, visuals=checks.boolean(visuals, "visuals"))
    task = OpenCabinetTask(scene, drawer=drawer, **task_options)
    set_render_quality(task.root_entity.mjcf_model, render_quality)
    return _environment(task, limit, random, environment_kwargs)


def _limit(time_limit: float | None) -> float:
    return math.inf if time_limit is None else checks.number(time_limit, "time_limit", positive=True)


def _environment(
    task: "SuiteTask",
    limit: float,
    random: int | np.random.RandomState | None,
    environment_kwargs: Mapping[str, Any] | None,
) -> "Environment":
    from kitchen_suite.environment import Environment

    takers = Environment, *Environment.__bases__
    checks.keywords(environment_kwargs or {}, *takers, what="environment argument", exclude=_SET_OF_ENVIRONMENT)
    settings = {
        "strip_singleton_obs_buffer_dim": True,
        "recompile_mjcf_every_episode": False,
        **(environment_kwargs or {}),
    }
    return Environment(task, time_limit=limit, random_state=random, **settings)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Domain:
    """A domain of the suite. Its Gymnasium environments are named by strings, which `gymnasium.register` takes.

    Attributes:
      build: builds an environment for `load`.
      tasks: by task name, the arguments that define the task: of `build` and of the Gymnasium environments.
      env_id: id of the Gymnasium environment.
      env: its class.
      vector_env: class of the vectorised environment.
      episode_steps: control steps in an episode.
    """

    build: "Callable[..., Environment]"
    tasks: Mapping[str, Mapping[str, Any]]
    env_id: str
    env: str
    vector_env: str
    episode_steps: int


# Spelt and ordered as in `tasks.GOALS`.
_KITCHEN_GOALS = (
    "bottom burner",
    "top burner",
    "light switch",
    "slide cabinet",
    "hinge cabinet",
    "microwave",
    "kettle",
)

# `complete` and `partial` are two data sets of D4RL, of demonstrations for the same four goals.
_KITCHEN_TASKS = {
    **{name.replace(" ", "_"): (name,) for name in _KITCHEN_GOALS},
    "complete": ("microwave", "kettle", "light switch", "slide cabinet"),
    "partial": ("microwave", "kettle", "light switch", "slide cabinet"),
    "mixed": ("microwave", "kettle", "bottom burner", "light switch"),
    "all": _KITCHEN_GOALS,
}

DOMAINS: Mapping[str, Domain] = MappingProxyType(
    {
        "kitchen": Domain(
            build=kitchen,
            tasks=MappingProxyType({name: {"tasks_to_complete": goals} for name, goals in _KITCHEN_TASKS.items()}),
            env_id="KitchenSuite/FrankaKitchen-v1",
            env="kitchen_suite.gymnasium_env.kitchen:FrankaKitchenEnv",
            vector_env="kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
            episode_steps=280,
        ),
        "open_cabinet": Domain(
            build=open_cabinet,
            tasks=MappingProxyType({f"{drawer}_drawer": {"drawer": drawer} for drawer in ("top", "bottom")}),
            env_id="KitchenSuite/FrankaOpenCabinet-v1",
            env="kitchen_suite.gymnasium_env.open_cabinet:FrankaOpenCabinetEnv",
            vector_env="kitchen_suite.vector_env.open_cabinet:FrankaOpenCabinetVectorEnv",
            episode_steps=700,
        ),
    }
)

# Task names by domain.
TASKS_BY_DOMAIN: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {name: tuple(domain.tasks) for name, domain in DOMAINS.items()}
)

# All pairs of domain and task name.
ALL_TASKS: tuple[tuple[str, str], ...] = tuple(
    (domain, task) for domain, tasks in TASKS_BY_DOMAIN.items() for task in tasks
)

# The tasks that papers report: the three task sets of D4RL's Franka kitchen.
BENCHMARKING: tuple[tuple[str, str], ...] = (("kitchen", "complete"), ("kitchen", "partial"), ("kitchen", "mixed"))


def task_arguments(domain_name: str, task_name: str) -> dict[str, Any]:
    """Returns the arguments that define a named task: of the domain's builder, and of its Gymnasium environment.

    Raises:
      TypeError: a name is no string.
      ValueError: an unknown domain or task.
    """
    tasks = DOMAINS[checks.choice(domain_name, DOMAINS.keys(), "domain")].tasks
    for other, names in TASKS_BY_DOMAIN.items():
        if task_name in names and task_name not in tasks:
            raise ValueError(f"task {task_name!r} belongs to domain {other!r}, not {domain_name!r}")
    return dict(tasks[checks.choice(task_name, tasks.keys(), f"task of domain {domain_name!r}")])


def check_not_fixed(domain_name: str, task_name: str, task_kwargs: Mapping[str, Any]) -> None:
    """Checks that arguments leave the definition of a named task unchanged, except for `tasks_to_complete`.

    Raises:
      ValueError: an argument is fixed by the task.
    """
    fixed = task_arguments(domain_name, task_name).keys() - {"tasks_to_complete"}
    if clash := sorted(fixed & task_kwargs.keys()):
        raise ValueError(f"task {task_name!r} fixes {clash}: task_kwargs cannot change it; choose another task")


def load(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> "Environment":
    """Builds an environment of the suite; the arguments are those of `dm_control.suite.load`.

    Args:
      domain_name: a key of `TASKS_BY_DOMAIN`.
      task_name: one of that domain's tasks.
      task_kwargs: arguments of the domain's builder (`kitchen` or `open_cabinet`), among them `random`, `time_limit`.
      environment_kwargs: further arguments of `Environment`.
      visualize_reward: whether objects change their colour while the task rewards their position.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: an unknown domain or task, or a value that the builder refuses.
    """
    task = task_arguments(domain_name, task_name)
    for name, kwargs in (("task_kwargs", task_kwargs), ("environment_kwargs", environment_kwargs)):
        if kwargs is not None and not isinstance(kwargs, Mapping):
            raise TypeError(f"{name} must be a dict or None, got {kwargs!r}")
    check_not_fixed(domain_name, task_name, task_kwargs or {})
    arguments = {**task, **(task_kwargs or {})}
    environment = DOMAINS[domain_name].build(**arguments, environment_kwargs=environment_kwargs)
    environment.task.visualize_reward = visualize_reward
    return environment


def default_task(domain_name: str) -> str:
    """Returns the name of a domain's first task in `BENCHMARKING`, or of its first task if it has none there.

    Raises:
      TypeError: the name is no string.
      ValueError: an unknown domain.
    """
    checks.choice(domain_name, TASKS_BY_DOMAIN.keys(), "domain")
    return next(task for domain, task in (*BENCHMARKING, *ALL_TASKS) if domain == domain_name)


def __dir__() -> list[str]:
    return __all__

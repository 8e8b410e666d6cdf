"""The domains and tasks of the suite, and `load`, with the interface of `dm_control.suite`."""

import functools
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from kitchen_suite import checks
from kitchen_suite.entities import CabinetConfig, build_kitchen_scene, build_open_cabinet_scene
from kitchen_suite.entities.props.cabinet import DRAWERS
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import GOALS, KitchenTask, OpenCabinetTask
from kitchen_suite.tasks.base import SuiteTask
from kitchen_suite.tasks.kitchen.task import TIME_LIMIT
from kitchen_suite.tasks.open_cabinet import task as cabinet_task


def kitchen(
    *,
    tasks_to_complete: Sequence[str],
    time_limit: float | None = TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    sleep: bool = False,
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> Environment:
    """Builds a kitchen environment.

    Args:
      tasks_to_complete: names of the tasks, spelt as in `tasks.GOALS`.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      sleep: whether MuJoCo may put resting objects to sleep: faster, but trajectories are only nearly the same; see
        `build_kitchen_scene`.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `KitchenTask`.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `KitchenTask`; or the time limit is not positive and finite.
    """
    limit = _limit(time_limit)
    scene = build_kitchen_scene(visuals=checks.boolean(visuals, "visuals"), sleep=checks.boolean(sleep, "sleep"))
    task = KitchenTask(scene, tasks_to_complete=tasks_to_complete, **task_options)
    return _environment(task, limit, random, environment_kwargs)


def open_cabinet(
    *,
    drawer: str,
    time_limit: float | None = cabinet_task.TIME_LIMIT,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    cabinet_config: CabinetConfig | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> Environment:
    """Builds an environment of a cabinet whose drawer is to be opened.

    Args:
      drawer: `top` or `bottom`.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      cabinet_config: dimensions and joint resistances of the cabinet; the default cabinet when omitted.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `OpenCabinetTask`.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `OpenCabinetTask`; or the time limit is not positive and finite.
    """
    limit = _limit(time_limit)
    if not isinstance(cabinet_config, CabinetConfig | None):
        raise TypeError(f"cabinet_config must be a CabinetConfig, got {cabinet_config!r}")
    scene = build_open_cabinet_scene(cabinet_config, visuals=checks.boolean(visuals, "visuals"))
    task = OpenCabinetTask(scene, drawer=drawer, **task_options)
    return _environment(task, limit, random, environment_kwargs)


def _limit(time_limit: float | None) -> float:
    return math.inf if time_limit is None else checks.number(time_limit, "time_limit", positive=True)


def _environment(
    task: SuiteTask,
    limit: float,
    random: int | np.random.RandomState | None,
    environment_kwargs: Mapping[str, Any] | None,
) -> Environment:
    settings = {
        "strip_singleton_obs_buffer_dim": True,
        "recompile_mjcf_every_episode": False,
        **(environment_kwargs or {}),
    }
    return Environment(task, time_limit=limit, random_state=random, **settings)


_KITCHEN_TASKS = {
    **{name.replace(" ", "_"): (name,) for name in GOALS},
    "complete": ("microwave", "kettle", "light switch", "slide cabinet"),
    "partial": ("microwave", "kettle", "light switch", "slide cabinet"),
    "mixed": ("microwave", "kettle", "bottom burner", "light switch"),
    "all": tuple(GOALS),
}

_DOMAINS: Mapping[str, Mapping[str, functools.partial[Environment]]] = MappingProxyType(
    {
        "kitchen": MappingProxyType(
            {name: functools.partial(kitchen, tasks_to_complete=tasks) for name, tasks in _KITCHEN_TASKS.items()}
        ),
        "open_cabinet": MappingProxyType(
            {f"{drawer}_drawer": functools.partial(open_cabinet, drawer=drawer) for drawer in DRAWERS}
        ),
    }
)

# Task names by domain.
TASKS_BY_DOMAIN: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {domain: tuple(tasks) for domain, tasks in _DOMAINS.items()}
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
    return dict(_find(domain_name, task_name).keywords)


def check_not_fixed(domain_name: str, task_name: str, task_kwargs: Mapping[str, Any]) -> None:
    """Checks that arguments leave the definition of a named task unchanged, except for `tasks_to_complete`.

    Raises:
      ValueError: an argument is fixed by the task.
    """
    fixed = task_arguments(domain_name, task_name).keys() - {"tasks_to_complete"}
    if clash := sorted(fixed & task_kwargs.keys()):
        raise ValueError(f"task {task_name!r} fixes {clash}: task_kwargs cannot change it; choose another task")


def _find(domain_name: str, task_name: str) -> functools.partial[Environment]:
    tasks = _DOMAINS[checks.choice(domain_name, _DOMAINS.keys(), "domain")]
    return tasks[checks.choice(task_name, tasks.keys(), f"task of domain {domain_name!r}")]


def load(
    domain_name: str,
    task_name: str,
    task_kwargs: Mapping[str, Any] | None = None,
    environment_kwargs: Mapping[str, Any] | None = None,
    visualize_reward: bool = False,
) -> Environment:
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
    build = _find(domain_name, task_name)
    for name, kwargs in (("task_kwargs", task_kwargs), ("environment_kwargs", environment_kwargs)):
        if kwargs is not None and not isinstance(kwargs, Mapping):
            raise TypeError(f"{name} must be a dict or None, got {kwargs!r}")
    check_not_fixed(domain_name, task_name, task_kwargs or {})
    environment = build(**(task_kwargs or {}), environment_kwargs=environment_kwargs)
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

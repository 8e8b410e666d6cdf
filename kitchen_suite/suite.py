"""The domains and tasks of the suite, and `load`, with the interface of `dm_control.suite`.

Importing this module registers the Gymnasium ids and does not import dm_control.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import gymnasium

from kitchen_suite import checks
from kitchen_suite.domains.base import Domain
from kitchen_suite.domains.kitchen import KITCHEN, kitchen
from kitchen_suite.domains.microwave_table import MICROWAVE_TABLE
from kitchen_suite.domains.open_cabinet import OPEN_CABINET, open_cabinet

if TYPE_CHECKING:
    from kitchen_suite.environment import Environment

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
    "register",
    "task_arguments",
]

_domains: dict[str, Domain] = {domain.name: domain for domain in (KITCHEN, OPEN_CABINET, MICROWAVE_TABLE)}

DOMAINS: Mapping[str, Domain] = MappingProxyType(_domains)
"""The domains by name: the suite's own and those of `register`."""

TASKS_BY_DOMAIN: Mapping[str, tuple[str, ...]]
"""Task names by domain."""

ALL_TASKS: tuple[tuple[str, str], ...]
"""All pairs of domain and task name."""

BENCHMARKING: tuple[tuple[str, str], ...]
"""The pairs of domain and task name that papers report."""


def __getattr__(name: str) -> Any:
    """Returns a table of tasks, made from `DOMAINS` as it is at present."""
    if name == "TASKS_BY_DOMAIN":
        return MappingProxyType({domain.name: tuple(domain.tasks) for domain in DOMAINS.values()})
    if name == "ALL_TASKS":
        return tuple((domain.name, task) for domain in DOMAINS.values() for task in domain.tasks)
    if name == "BENCHMARKING":
        return tuple((domain.name, task) for domain in DOMAINS.values() for task in domain.benchmark_tasks)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


def register(domain: Domain) -> None:
    """Adds a domain to the suite: for `load`, for the commands in this process, and as ids of Gymnasium.

    Raises:
      TypeError: it is no `Domain`.
      ValueError: a domain of its name exists, or Gymnasium has one of its ids; nothing has changed then.
    """
    if not isinstance(domain, Domain):
        raise TypeError(f"domain must be a Domain, got {domain!r}")
    if domain.name in DOMAINS:
        raise ValueError(f"a domain {domain.name!r} exists already; choose another name")
    ids = {domain.env_id, *domain.task_ids.values()}
    if taken := sorted(ids & gymnasium.registry.keys()):
        raise ValueError(f"Gymnasium has environments of the ids {taken} already; choose another env_id or task_id")
    _register_ids(domain)
    _domains[domain.name] = domain


def _register_ids(domain: Domain) -> None:
    """Registers the ids of a domain with Gymnasium, those that it does not have yet."""
    tasks = {domain.task_ids[task]: arguments for task, arguments in domain.tasks.items()}
    for env_id, arguments in {domain.env_id: {}, **tasks}.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point=domain.env,
                vector_entry_point=domain.vector_env,
                max_episode_steps=domain.episode_steps,
                kwargs=dict(arguments),
            )


for _domain in DOMAINS.values():
    _register_ids(_domain)


def find_domain(name: str) -> Domain:
    """Returns a domain.

    Args:
      name: a key of `DOMAINS`; or `module:NAME`, a `Domain` of the user's own, which is imported and, unless it is
        registered already, registered. Modules are also looked for in the working directory.

    Raises:
      TypeError: the name is no string.
      ValueError: there is no domain of that name, or the `Domain` cannot be imported or registered.
    """
    if not isinstance(name, str) or ":" not in name:
        return DOMAINS[checks.choice(name, DOMAINS.keys(), "domain")]
    domain = checks.imported(name, "domain")
    if not isinstance(domain, Domain):
        raise ValueError(f"domain {name!r} is no kitchen_suite.suite.Domain: it is {domain!r}")
    if DOMAINS.get(domain.name) is not domain:
        register(domain)
    return domain


def task_arguments(domain_name: str, task_name: str) -> dict[str, Any]:
    """Returns the arguments that define a named task: of the domain's builder, and of its Gymnasium environment.

    Raises:
      TypeError: a name is no string.
      ValueError: an unknown domain or task.
    """
    domain = find_domain(domain_name)
    others = [other.name for other in DOMAINS.values() if task_name in tuple(other.tasks)]
    if others and domain.name not in others:
        raise ValueError(f"task {task_name!r} belongs to domain {others[0]!r}, not {domain.name!r}")
    return dict(domain.tasks[checks.choice(task_name, domain.tasks.keys(), f"{domain.name!r} task")])


def check_not_fixed(domain_name: str, task_name: str, task_kwargs: Mapping[str, Any]) -> None:
    """Checks that arguments leave the definition of a named task unchanged, except for what is `replaceable`.

    Raises:
      ValueError: an argument is fixed by the task.
    """
    fixed = task_arguments(domain_name, task_name).keys() - find_domain(domain_name).replaceable
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
      domain_name: a key of `DOMAINS`, or `module:NAME` as for `find_domain`.
      task_name: one of that domain's tasks.
      task_kwargs: arguments of the domain's builder, such as `kitchen`, among them `random` and `time_limit`.
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
    environment = find_domain(domain_name).build(**arguments, environment_kwargs=environment_kwargs)
    environment.task.visualize_reward = visualize_reward
    return environment


def default_task(domain_name: str) -> str:
    """Returns the name of a domain's first task in `BENCHMARKING`, or of its first task if it has none there.

    Raises:
      TypeError: the name is no string.
      ValueError: an unknown domain.
    """
    return find_domain(domain_name).default_task

"""The domains and tasks of the suite, and `load`, with the interface of `dm_control.suite`.

Importing this module registers the Gymnasium ids and does not import dm_control.
"""

import json
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import gymnasium

from kitchen_suite import agreement, checks, imports, lazy
from kitchen_suite.domains.domain import Domain
from kitchen_suite.domains.generated_kitchens import KITCHENS
from kitchen_suite.domains.kitchen import KITCHEN
from kitchen_suite.domains.microwave_table import MICROWAVE_TABLE
from kitchen_suite.domains.open_cabinet import OPEN_CABINET
from kitchen_suite.domains.pick_and_place import PICK_AND_PLACE
from kitchen_suite.environment_classes import ANY_ENVIRONMENT

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
    "kitchens",
    "load",
    "microwave_table",
    "open_cabinet",
    "pick_and_place",
    "register",
    "task_arguments",
]

# Separators, for the error about several names of tasks in place of one.
_SEVERAL = re.compile(r"\s*[,;+]\s*")

_own = (KITCHEN, OPEN_CABINET, MICROWAVE_TABLE, KITCHENS, PICK_AND_PLACE)
_domains: dict[str, Domain] = {domain.name: domain for domain in _own}

# Names of the suite's own domains.
_OF_THE_SUITE = frozenset(_domains)

DOMAINS: Mapping[str, Domain] = MappingProxyType(_domains)
"""The domains by name: the suite's own and those of `register`."""

kitchen = KITCHEN.load
"""Builds a kitchen; arguments as in `Domain.load`, `build_kitchen_scene` and `KitchenTask`.

Without `tasks_to_complete` it asks for the seven tasks of FrankaKitchen-v1, as the task `all` does.
"""

kitchens = KITCHENS.load
"""Builds a generated kitchen; arguments as in `Domain.load`, `build_generated_kitchen` and `GeneratedKitchenTask`."""

open_cabinet = OPEN_CABINET.load
"""Builds a cabinet; arguments as in `Domain.load`, `build_open_cabinet_scene` and `OpenCabinetTask`."""

microwave_table = MICROWAVE_TABLE.load
"""Builds a microwave table; arguments as in `Domain.load` and `MicrowaveTableTask`."""

pick_and_place = PICK_AND_PLACE.load
"""Builds a kitchen with objects; arguments as in `Domain.load`, `build_pick_and_place` and `PickAndPlaceTask`."""

TASKS_BY_DOMAIN: Mapping[str, tuple[str, ...]]
"""Task names by domain."""

ALL_TASKS: tuple[tuple[str, str], ...]
"""All pairs of domain and task name."""

BENCHMARKING: tuple[tuple[str, str], ...]
"""The pairs of domain and task name that papers report."""

# Made from `DOMAINS` as it is at present.
_TABLES: dict[str, Callable[[], Any]] = {
    "TASKS_BY_DOMAIN": lambda: MappingProxyType({domain.name: tuple(domain.tasks) for domain in DOMAINS.values()}),
    "ALL_TASKS": lambda: tuple((domain.name, task) for domain in DOMAINS.values() for task in domain.tasks),
    "BENCHMARKING": lambda: tuple((each.name, task) for each in DOMAINS.values() for task in each.benchmark_tasks),
}
__getattr__, __dir__ = lazy.attributes(__name__, __all__, _TABLES)


def register(domain: Domain) -> None:
    """Adds a domain to the suite: for `load`, for the commands in this process, and as ids of Gymnasium.

    Plays ten steps of random actions and another reset of the default task in an environment of `load`, in a single one
    of Gymnasium, and in the first of three vectorised ones, which must agree in all numbers. The others have seeds and
    actions of their own, so that what mixes the environments of a batch shows. Then another of the three is the first.

    Then bounds the energy that ten steps of random actions put into the scene, in each physics that holds its free
    objects: what exceeds it is thrown. Warns of a class that adds rewards or terminations and leaves success to a task
    of the suite.

    Raises:
      TypeError: it is no `Domain`, or a term returns neither numbers nor, where it must, bools.
      ValueError: a domain of its name exists, Gymnasium has one of its ids, the environments differ, a term reads
        what is not there, writes into a step, or returns a reward that is not finite, or a body gains more energy than
        a hand gives it; the message names the first difference, the term or the body. Nothing has changed then.
    """
    if not isinstance(domain, Domain):
        raise TypeError(f"domain must be a Domain, got {checks.shown(domain)}")
    if domain.name in DOMAINS:
        raise ValueError(f"a domain {domain.name!r} exists already; choose another name")
    ids = {domain.env_id, *domain.task_ids.values()}
    if taken := sorted(ids & gymnasium.registry.keys()):
        raise ValueError(f"Gymnasium has environments of the ids {taken} already; choose another env_id or task_id")
    _domains[domain.name] = domain
    _register_ids(domain, {"domain": domain.name})
    try:
        agreement.check_front_ends(domain, _OF_THE_SUITE)
    except BaseException:
        del _domains[domain.name]
        for env_id in ids:
            del gymnasium.registry[env_id]
        raise


def _register_ids(domain: Domain, arguments: Mapping[str, Any]) -> None:
    """Registers the ids of a domain with Gymnasium, those that it does not have yet, with further arguments."""
    of_tasks = {domain.task_ids[task]: of_task for task, of_task in domain.tasks.items()}
    # Arguments of one task among several would be left to those that `make` adds for another one.
    general = next(iter(of_tasks.values())) if len(of_tasks) == 1 else {}
    for env_id, of_id in {domain.env_id: general, **of_tasks}.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point=domain.env_entry_point,
                vector_entry_point=domain.vector_env_entry_point,
                max_episode_steps=domain.episode_steps,
                kwargs={**arguments, **of_id},
            )


for _domain in DOMAINS.values():
    # A class of its own knows its domain.
    _register_ids(_domain, {"domain": _domain.name} if _domain.env == ANY_ENVIRONMENT.single else {})


def find_domain(name: str) -> Domain:
    """Returns a domain; raises a ValueError if there is none, or it cannot be imported or registered.

    Args:
      name: a key of `DOMAINS`; or `module:NAME`, a `Domain` of the user's own, which is imported and, unless it is
        registered already, registered. Modules are also looked for in the working directory.
    """
    if not isinstance(name, str) or ":" not in name:
        owners = [domain.name for domain in DOMAINS.values() if isinstance(name, str) and name in domain.tasks]
        if owners and name not in DOMAINS:
            raise ValueError(f"{name!r} is a task, not a domain: choose domain {owners[0]!r}")
        return DOMAINS[checks.choice(name, DOMAINS.keys(), "domain")]
    domain = imports.named(name, "domain")
    if not isinstance(domain, Domain):
        raise ValueError(f"domain {checks.shown(name)} is no kitchen_suite.suite.Domain: it is {checks.shown(domain)}")
    if DOMAINS.get(domain.name) != domain:
        register(domain)
    return DOMAINS[domain.name]


def check_named(domain_name: object, task_kwargs: Mapping[str, Any]) -> None:
    """Raises a ValueError for a domain or a robot of somebody's own that a file names, and nobody else here.

    Files may name the suite's own, those that this program has registered, and those of `find_domain("module:NAME")`
    and `entities.arms.robot_spec("module:NAME")`.
    """
    imports.check_named(domain_name, "domain")
    imports.check_named(task_kwargs.get("robot"), "robot")


def task_arguments(domain_name: str, task_name: str) -> dict[str, Any]:
    """Returns the arguments that define a named task: of `Domain.load`, and of its Gymnasium environment."""
    domain = find_domain(domain_name)
    if isinstance(task_name, str) and task_name not in domain.tasks:
        _check_task_of(domain, task_name)
    return dict(domain.tasks[checks.choice(task_name, domain.tasks.keys(), f"{domain.name!r} task")])


def _check_task_of(domain: Domain, name: str) -> None:
    """Raises a ValueError if what a domain does not have as a task is a domain, several tasks, or another's task."""
    others = [other.name for other in DOMAINS.values() if name in other.tasks]
    if others:
        raise ValueError(f"task {name!r} belongs to domain {others[0]!r}, not {domain.name!r}")
    meant = checks.same_name(name, DOMAINS)
    if meant and checks.same_name(name, domain.tasks) is None:
        tasks = checks.shortened(str([*DOMAINS[meant].tasks]))
        raise ValueError(f"{name!r} is a domain, not a task: choose domain {meant!r} and one of its tasks, {tasks}")
    several = [checks.same_name(part, domain.tasks) for part in _SEVERAL.split(name)]
    if len(several) > 1 and all(several):
        goals = {
            argument: [each for task in several for each in domain.tasks[str(task)].get(argument, ())]
            for argument in domain.replaceable
        }
        how = f"name one, and all of them in the task_kwargs, {json.dumps(goals)}" if goals else "name one"
        raise ValueError(f"{name!r} are several tasks of domain {domain.name!r}: {how}")


def check_not_fixed(domain_name: str, task_name: str, task_kwargs: Mapping[str, Any]) -> None:
    """Raises a ValueError if arguments change the definition of a named task beyond what is `replaceable`."""
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
      task_kwargs: arguments of `Domain.load`, among them `random` and `time_limit`, and of the domain's scene and task.
      environment_kwargs: further arguments of `Environment`.
      visualize_reward: whether objects change their colour while the task rewards their position.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: an unknown domain or task, or a value that is refused.
    """
    task = task_arguments(domain_name, task_name)
    given = checks.arguments(task_kwargs, "task_kwargs")
    checks.arguments(environment_kwargs, "environment_kwargs")
    check_not_fixed(domain_name, task_name, given)
    arguments = {**task, **given}
    environment = find_domain(domain_name).load(**arguments, environment_kwargs=environment_kwargs)
    environment.task.visualize_reward = visualize_reward
    return environment


def default_task(domain_name: str) -> str:
    """Returns the name of a domain's first task in `BENCHMARKING`, or of its first task if it has none there."""
    return find_domain(domain_name).default_task

"""The domains and tasks of the suite, and `load`, with the interface of `dm_control.suite`.

Importing this module registers the Gymnasium ids and does not import dm_control.
"""

import contextlib
import json
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, imports, lazy
from kitchen_suite.domains.base import Domain
from kitchen_suite.domains.generated_kitchens import KITCHENS
from kitchen_suite.domains.kitchen import KITCHEN
from kitchen_suite.domains.microwave_table import MICROWAVE_TABLE
from kitchen_suite.domains.open_cabinet import OPEN_CABINET
from kitchen_suite.names import ANY_ENVIRONMENT

if TYPE_CHECKING:
    from kitchen_suite.entities import Scene
    from kitchen_suite.environment import Environment
    from kitchen_suite.tasks import SuiteTask

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
    "register",
    "task_arguments",
]

# Separators, for the error about several names of tasks in place of one.
_SEVERAL = re.compile(r"\s*[,;+]\s*")

_domains: dict[str, Domain] = {domain.name: domain for domain in (KITCHEN, OPEN_CABINET, MICROWAVE_TABLE, KITCHENS)}

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

    Warns of a class that adds rewards or terminations and leaves success to a task of the suite, and of free objects in
    a scene with fast physics, which is not made for them.

    Raises:
      TypeError: it is no `Domain`, or a term returns neither numbers nor, where it must, bools.
      ValueError: a domain of its name exists, Gymnasium has one of its ids, the environments differ, or a term reads
        what is not there, writes into a step, or returns a reward that is not finite; the message names the first
        difference or the term. Nothing has changed then.
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
        _check_front_ends(domain)
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


# Control steps that a registration plays with each pair of seeds.
_REGISTRATION_STEPS = 10

# Seeds of vectorised environments, of which the first is compared with a single one. What mixes the environments of a
# batch may show in some of them alone, such as in that whose joints are slower, or where there are three.
_REGISTRATION_SEEDS = ((0, 1, 2), (1, 2, 0))


def _check_front_ends(domain: Domain) -> None:
    """Raises a ValueError unless the environments of a domain's default task are the same in all three front ends."""
    task, env_id = domain.default_task, domain.task_ids[domain.default_task]
    with contextlib.ExitStack() as stack:
        single = gymnasium.make(env_id, disable_env_checker=True)
        stack.callback(single.close)
        count = len(_REGISTRATION_SEEDS[0])
        many = gymnasium.make_vec(env_id, count, vectorization_mode="vector_entry_point", num_threads=1)
        stack.callback(many.close)
        _check_equal("action space", single.action_space, many.single_action_space, env_id)
        _check_equal("observation space", single.observation_space, many.single_observation_space, env_id)
        environment = domain.load(**domain.tasks[task], time_limit=None, visuals=False)
        stack.callback(environment.close)
        _check_episodes(single, many, environment)
        _warn_of_success(environment.task)
        _warn_of_free_objects(environment.task.scene)


def _warn_of_success(task: "SuiteTask") -> None:
    """Warns if a class has terms of its own, and the tasks of one of the suite's domains decide its success."""
    from kitchen_suite.tasks import terms

    added = [*terms.added(task, "extra_rewards"), *task.terminations]
    if added and not task.successes and task.domain_name in _OF_THE_SUITE:
        warnings.warn(
            f"{type(task).__name__} adds {added} to rewards and terminations, and its success is still that of "
            f"{task!r}: is_success, scores, comparisons and the checkpoints that training keeps do not depend on what "
            "it adds. If it has another success, add functions of a step that return bools to extra_successes; see "
            "docs/guide/custom_objects.md",
            stacklevel=4,
        )


def _warn_of_free_objects(scene: "Scene") -> None:
    """Warns of a user's free objects in a scene with `fast` physics."""
    from dm_control import mjcf

    free = [name for name, entity in scene.attached.items() if mjcf.get_frame_freejoint(entity.mjcf_model) is not None]
    if free and scene.arena.fast_physics is not None:
        warnings.warn(
            f"the free objects {free} may be thrown out of the fingers with physics='fast', which is tuned to the "
            "suite's own objects: use physics='exact', and noslip_iterations where they are held; see "
            "docs/guide/custom_objects.md",
            stacklevel=4,
        )


def _check_episodes(single: gymnasium.Env, many: Any, environment: "Environment") -> None:
    """Plays episodes in three environments; raises a ValueError where they differ.

    Args:
      single: of Gymnasium.
      many: vectorised ones, of which the first is compared; the others have other seeds and other actions.
      environment: of dm_env.
    """
    for seeds in _REGISTRATION_SEEDS:
        generators = [np.random.default_rng(seed) for seed in seeds]
        _check_reset(single, many, environment, seeds)
        for step in range(1, _REGISTRATION_STEPS + 1):
            actions = np.stack([_random_action(single.action_space, generator) for generator in generators])
            if _check_actions(single, many, environment, actions, f"after step {step}"):
                _check_reset(single, many, environment)
        _check_reset(single, many, environment)


def _check_reset(
    single: gymnasium.Env, many: Any, environment: "Environment", seeds: Sequence[int] | None = None
) -> None:
    """Resets the environments of `_check_episodes`, with seeds or without; raises a ValueError where they differ."""
    inner: Any = single.unwrapped
    observation, _ = single.reset(seed=seeds[0] if seeds else None)
    many_observation, _ = many.reset(seed=seeds and [*seeds])
    if seeds:
        generator = gymnasium.utils.seeding.np_random(seeds[0])[0]
        environment.random_state = np.random.RandomState(generator.bit_generator)
    timestep = environment.reset()
    _check_step("at a reset", inner.spec.id, observation, many_observation, inner, timestep.observation)


def _check_actions(single: gymnasium.Env, many: Any, environment: "Environment", actions: NDArray, after: str) -> bool:
    """Makes a step of the environments of `_check_episodes`; raises a ValueError where they differ.

    Returns whether it has ended the episode.
    """
    inner: Any = single.unwrapped
    where = inner.spec.id
    observation, reward, terminated, truncated, info = single.step(actions[0])
    many_observation, rewards, terminations, truncations, many_info = many.step(actions)
    timestep = environment.step(inner.clip_actions(actions[0].astype(np.float64)))
    _check_step(after, where, observation, many_observation, inner, timestep.observation)
    _check_equal(f"reward {after}", reward, rewards[0].item(), where)
    _check_equal(f"termination {after}", terminated, bool(terminations[0]), where)
    _check_equal(f"truncation {after}", truncated, bool(truncations[0]), where)
    _check_equal(f"reward {after}", reward, timestep.reward, where, "dm_env's")
    _check_equal(f"discount {after}", 0.0 if terminated else 1.0, timestep.discount, where, "dm_env's")
    ours, theirs = _arrays(info, "info"), _arrays(many_info, "info")
    for key, array in [*ours.items(), *theirs.items()]:
        if key.startswith("info['reward/") and not np.isfinite(array).all():
            name = key.removeprefix("info['reward/").removesuffix("']")
            raise ValueError(f"the term {name!r} of the reward of {where} must be finite, got {array} {after}")
    for key, array in ours.items():
        # Lists of names are objects in the vectorised one, or missing.
        if key in theirs and theirs[key].dtype != object:
            shape = (len(actions), *array.shape)
            _check_equal(f"shape in a batch of {key} {after}", shape, theirs[key].shape, where)
            _check_equal(f"{key} {after}", array.tolist(), theirs[key][0].tolist(), where)
    return bool(terminated or truncated)


def _random_action(space: gymnasium.Space, generator: np.random.Generator) -> NDArray:
    """Returns a random action, within the bounds of its space."""
    assert isinstance(space, gymnasium.spaces.Box)
    return generator.normal(size=space.shape).clip(space.low, space.high).astype(np.float32)


def _check_step(
    when: str, where: str, observation: Any, many_observation: Any, inner: Any, suite_observation: Any
) -> None:
    """Raises a ValueError unless the observations of a step are the same in three environments."""
    one, other = _arrays(observation), _arrays(many_observation)
    _check_equal(f"keys {when}", [*one], [*other], where)
    for key, array in one.items():
        _check_equal(f"shape of {key} {when}", array.shape, other[key].shape[1:], where)
        _check_equal(f"{key} {when}", array.tolist(), other[key][0].tolist(), where)
    ours, theirs = inner.present_observation, suite_observation
    _check_equal(f"observations {when}", sorted(ours), sorted(theirs), where, "dm_env's")
    for key, array in ours.items():
        found = np.asarray(theirs[key]).astype(array.dtype)
        _check_equal(f"observation[{key!r}] {when}", array.tolist(), found.tolist(), where, "dm_env's")


# Functions of NumPy whose last digit is another for one number than for many, or for arrays of another order, with what
# is equal.
_LAST_DIGITS = (
    "where only the last digits differ, write x ** p as np.power(x, p), and compute sums, means and norms, such as "
    "np.linalg.norm(x, axis=-1), of a copy in C order: np.sqrt(np.ascontiguousarray(x * x).sum(-1)); "
)


def _check_equal(what: str, found: Any, expected: Any, where: str, other: str = "the vectorised") -> None:
    # NaN is not equal to itself; all digits of numbers are in their representation.
    same_numbers = isinstance(found, float | list) and repr(found) == repr(expected)
    if found != expected and not same_numbers:
        raise ValueError(
            f"{what} of {where} is {checks.shown(found)} in the single environment and {checks.shown(expected)} in "
            f"{other} one: add observations, rewards and terminations to extra_observations, extra_rewards and "
            "extra_terminations of the task, which act in all of them, and compute each environment of a batch alone, "
            f"reducing along the last axis; {_LAST_DIGITS}see docs/guide/extending.md"
        )


def _arrays(observation: Any, key: str = "observation") -> dict[str, np.ndarray]:
    """Returns the arrays of an observation by key, such as `observation['pixels']`."""
    if not isinstance(observation, Mapping):
        return {key: np.asarray(observation)}
    parts = ((f"{key}[{name!r}]", part) for name, part in observation.items())
    return {name: array for each, part in parts for name, array in _arrays(part, each).items()}


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

"""Whether a registered domain is the same in all three front ends: dm_env, single and vectorised environments."""

import contextlib
import warnings
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.domains.domain import Domain
from kitchen_suite.physics_names import PHYSICS

if TYPE_CHECKING:
    from kitchen_suite.environment import Environment
    from kitchen_suite.tasks import SuiteTask

# Control steps that a registration plays with each pair of seeds.
_REGISTRATION_STEPS = 10

# Seeds of vectorised environments, of which the first is compared with a single one. What mixes the environments of a
# batch may show in some of them alone, such as in that whose joints are slower, or where there are three.
_REGISTRATION_SEEDS = ((0, 1, 2), (1, 2, 0))


def check_front_ends(domain: Domain, own_domains: Collection[str]) -> None:
    """Raises a ValueError unless the environments of a domain's default task are the same in all three front ends.

    Args:
      domain: registered with Gymnasium already.
      own_domains: names of the suite's own domains, whose tasks decide about the success of a class that has none.
    """
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
        _warn_of_success(environment.task, own_domains)
        _check_energies(domain, environment)


def _warn_of_success(task: "SuiteTask", own_domains: Collection[str]) -> None:
    """Warns if a class has terms of its own, and the tasks of one of the suite's domains decide its success."""
    from kitchen_suite.tasks import terms

    added = [*terms.added(task, "extra_rewards"), *task.terminations]
    if added and not task.successes and task.domain_name in own_domains:
        warnings.warn(
            f"{type(task).__name__} adds {added} to rewards and terminations, and its success is still that of "
            f"{task!r}: is_success, scores, comparisons and the checkpoints that training keeps do not depend on what "
            "it adds. If it has another success, add functions of a step that return bools to extra_successes; see "
            "docs/guide/your_task.md",
            stacklevel=4,
        )


def _check_energies(domain: Domain, environment: "Environment") -> None:
    """Bounds the energy that random actions put into a domain's scene, in the other physics where that holds objects.

    `environment` is one of the domain in its own physics.
    """
    from kitchen_suite.energy import check_energy

    check_energy(environment)
    scene = environment.task.scene
    fast = scene.arena.fast_physics
    if not scene.free_objects or fast is None or fast.holding_timestep is None:
        return
    (other,) = {*PHYSICS} - {scene.physics}
    task = domain.tasks[domain.default_task]
    with contextlib.closing(domain.load(**{**task, "physics": other}, time_limit=None, visuals=False)) as another:
        check_energy(another)


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
            f"reducing along the last axis; {_LAST_DIGITS}see docs/guide/your_task.md#rewards-terminations-and-success"
        )


def _arrays(observation: Any, key: str = "observation") -> dict[str, np.ndarray]:
    """Returns the arrays of an observation by key, such as `observation['pixels']`."""
    if not isinstance(observation, Mapping):
        return {key: np.asarray(observation)}
    parts = ((f"{key}[{name!r}]", part) for name, part in observation.items())
    return {name: array for each, part in parts for name, array in _arrays(part, each).items()}

"""Episodes: played from one seed, and read from files with numpy alone."""

import collections
import contextlib
import json
import resource
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kitchen_suite import experts, policies
from kitchen_suite.episodes.play import SingleRollout, play_many
from kitchen_suite.policies import PolicyRef


def play(environment, build_policy, seed):
    """Plays an episode; returns its actions. The task's `episode_metrics` are then those of the episode."""
    environment.random_state = seed
    policy = build_policy(environment, np.random.default_rng((seed, 1)))
    timestep, actions = environment.reset(), []
    while not timestep.last():
        actions.append(policy(timestep))
        timestep = environment.step(actions[-1])
    return np.array(actions)


def play_expert(environment, **options):
    """Plays an episode by the expert, whose constructor gets the options; returns the metrics of the episode."""
    policy = experts.make_policy(environment, np.random.default_rng(0), **options)
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))
    return environment.task.episode_metrics


def successes(environment, seeds, policy="expert"):
    """Returns the number of successes of a policy, by its name, in the episodes of some seeds."""
    build, count = policies.find(policy), 0
    for seed in seeds:
        play(environment, build, seed)
        count += environment.task.episode_metrics["success"]
    return count


def successes_together(environments, policy, seed):
    """Returns the number of successes of a policy of observations in the first episodes of vectorised environments."""
    observations, infos = environments.reset(seed=seed)
    ended, succeeded = np.zeros(environments.num_envs, bool), np.zeros(environments.num_envs, bool)
    while not ended.all():
        observations, _, terminations, truncations, infos = environments.step(policy(observations))
        ending = (terminations | truncations) & ~ended
        succeeded[ending] = infos["is_success"][ending]
        ended |= ending
    return succeeded.sum()


def load_episode(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Returns the metadata and the arrays of an episode file."""
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    return json.loads(str(arrays.pop("metadata"))), arrays


def assert_same_arrays(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> None:
    """Asserts that names, types and values are the same."""
    assert list(one) == list(other)
    for name, array in one.items():
        assert array.dtype == other[name].dtype, name
        np.testing.assert_array_equal(array, other[name], name)


def nested(arrays: Mapping[str, np.ndarray], name: str, row: int) -> Any:
    """Returns a row of the arrays whose paths begin with `name`, as dicts of dicts."""
    if name in arrays:
        return arrays[name][row]
    keys = dict.fromkeys(path.split("/")[name.count("/") + 1] for path in arrays if path.startswith(f"{name}/"))
    return {key: nested(arrays, f"{name}/{key}", row) for key in keys}


@contextlib.contextmanager
def limited_files(size: int) -> Iterator[None]:
    """Limits files of this process and its children to `size` bytes: a full disk, for which no root is needed."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def rollout_of(spec, **extra):
    """Plays the episodes of a specification one by one, by the policy that it names."""
    return SingleRollout(spec, PolicyRef.parse(spec.policy).builder(spec.policy_sha256), **extra)


def played_together(spec, count, num_envs):
    """The first episodes of a specification by number, of environments that are stepped together."""
    waiting = collections.deque((index, spec.seed + index) for index in range(count))
    return {episode.index: episode for episode in play_many(spec, PolicyRef.parse(spec.policy), waiting, num_envs, 1)}

"""Hyperparameters: each is in its range, both ends included as they are written, or is refused before any training."""

import dataclasses
import json
import math

import numpy as np
import pytest
from helpers.errors import refused
from helpers.training import environments, learner

from kitchen_suite import suite
from kitchen_suite.training.recipes import Recipe, Schedule, checked, find_schedule, ranges

torch = pytest.mark.torch


def changed(kind, name, value, **others):
    """The value of a field after a change through JSON, as commands give it."""
    return getattr(checked(kind, {**others, **json.loads(json.dumps({name: value}))}, "hyperparameter"), name)


def ppo():
    from kitchen_suite.training.ppo import PPOHyperparameters

    return PPOHyperparameters


def bc():
    from kitchen_suite.training.bc import BCHyperparameters

    return BCHyperparameters


@torch
def test_defaults_are_in_the_ranges_of_all_hyperparameters():
    for kind in (ppo(), bc()):
        defaults = dataclasses.asdict(kind())
        assert checked(kind, defaults, "hyperparameter") == kind()
        assert ranges(kind).keys() == defaults.keys()


# Of both methods, with the numbers inside and outside of each range.
EXPECTED = {
    "num_envs": ([1, 2**16], [0, 2**16 + 1, 10**400, 2.5, True]),
    "learning_rate": ([1e-9, 1e30], [0, -1e-3, math.inf, math.nan]),
    "discount": ([1e-3, 1], [0, 1.01]),
    "gae_lambda": ([0, 1], [-0.1, 1.1]),
    "averaging": ([0, 0.999], [1]),
    "noise_correlation": ([0, math.nextafter(1, 0)], [1]),
    "ratio_clip": ([1e-3, 1], [0, -0.1]),
    "entropy_scale": ([0, 0.01], [-0.01]),
    "gradient_norm": ([0, 100.0], [-1, "fast", None]),
    "kl_target": ([0, 1.0], [-0.1]),
    "exploration": ([0.01, 10], [0]),
    "standardisation_epsilon": ([1e-8, 1], [0]),
    "value_batches": ([0, 1], [-1]),
    "learning_epochs": ([1], [0]),
    "hidden": ([[], [1, 2**14]], [64, [8, 0], [2**14 + 1], ["8"]]),
    "action_scale": ([[0.01, 2.0]], [[0], [-1]]),
}


@torch
@pytest.mark.parametrize("name", EXPECTED)
def test_numbers_in_range_are_kept_and_others_named_with_the_range(name):
    inside, outside = EXPECTED[name]
    for value in inside:
        kept = changed(ppo(), name, value, mini_batches=1)
        assert ([*kept] if isinstance(kept, tuple) else kept) == value
    for value in outside:
        with refused(ValueError, f"{name} must be in {ranges(ppo())[name]}, got"):
            changed(ppo(), name, value)


@torch
def test_errors_name_the_value_and_what_is_expected():
    with refused(ValueError, "num_envs must be in [1, 65536], got 0 (Expected `int` >= 1)"):
        changed(ppo(), "num_envs", 0)
    with refused(ValueError, "hidden must be in [1, 16384], got 64 (Expected `array`, got `int`)"):
        changed(ppo(), "hidden", 64)
    with refused(ValueError, "batch_size must be in [1, 1048576], got 0"):
        changed(bc(), "batch_size", 0)
    with refused(ValueError, "hyperparameter 'num_env' does not exist (did you mean 'num_envs'?)"):
        changed(ppo(), "num_env", 5)


@torch
def test_numbers_and_arrays_of_numpy_are_taken_as_those_of_python():
    given = {"num_envs": np.int64(8), "learning_rate": np.float32(0.5), "hidden": np.array([4, 6])}
    made = checked(ppo(), given, "hyperparameter")
    assert json.dumps([made.num_envs, made.learning_rate, made.hidden]) == "[8, 0.5, [4, 6]]"


@torch
def test_combinations_are_checked():
    with refused(ValueError, "mini_batches 2", "25"):
        changed(ppo(), "mini_batches", 2, num_envs=5, rollouts=5)
    with refused(ValueError, "rollouts", "at least 2", "num_envs is 1"):
        changed(ppo(), "mini_batches", 1, num_envs=1, rollouts=1)
    with refused(ValueError, "executed", "8", "9"):
        changed(bc(), "executed", 9)


# Of a domain of the test.
BAD = Recipe(hyperparameters={"discount": 0.0}, schedule={"eval_interval": 0})


@pytest.fixture
def bad_recipe(monkeypatch):
    domain = dataclasses.replace(suite.find_domain("kitchen"), training=f"{__name__}:BAD")
    monkeypatch.setitem(suite._domains, "kitchen", domain)


@torch
def test_the_recipe_of_a_domain_is_checked_as_well(bad_recipe):
    with refused(ValueError, "discount must be in (0, 1], got 0.0"):
        ppo().for_domain("kitchen")


def test_the_schedule_of_a_domain_is_checked_as_well(bad_recipe):
    with refused(ValueError, "eval_interval must be in [1, 1000000000000], got 0"):
        find_schedule("kitchen", "ppo")


def test_schedules_are_checked():
    for name, value in {"num_steps": -1, "patience": 2.5, "target_success": -0.1, "eval_episodes": 2**16 + 1}.items():
        with refused(ValueError, f"{name} must be in {ranges(Schedule)[name]}, got {value}"):
            find_schedule("kitchen", "bc", **{name: value})
    assert find_schedule("kitchen", "bc", num_steps=5).num_steps == 5


LEAST = {
    "num_envs": 1,
    "rollouts": 2,
    "learning_epochs": 1,
    "mini_batches": 1,
    "hidden": [],
    "gae_lambda": 0,
    "kl_target": 0,
    "value_clip": 0,
    "entropy_scale": 0,
    "gradient_norm": 0,
    "averaging": 0,
    "value_batches": 0,
    "noise_correlation": 0,
    "standardisation_epsilon": 1e-8,
}


@torch
def test_a_learner_of_the_least_hyperparameters_learns_and_is_exported():
    envs = environments(1, max_episode_steps=5)
    taught = learner(envs, **LEAST, action_scale=[0.01] * 8)
    rng = np.random.default_rng(0)
    size = taught.batch.observations.shape[-1]
    taught.imitate(rng.normal(size=(1, size)).astype(np.float32), rng.normal(size=(1, 8)).astype(np.float32))
    assert taught.warmup_batches == 0
    fresh = learner(envs, **LEAST, action_scale=[0.01] * 8)
    for each in (taught, fresh):
        each.start(0)
        for _ in range(3):
            assert np.isfinite([*each.learn().values()]).all()
        assert each.export({}).layers == [size, 8]
    envs.close()

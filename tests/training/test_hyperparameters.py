"""Hyperparameters: each is in its range, both ends included as they are written, or is refused before any training."""

import dataclasses
import json
import math

import numpy as np
import pytest
from helpers.errors import refused
from helpers.training import environments, learner

from kitchen_suite import suite
from kitchen_suite.training.ranges import Interval, ranges
from kitchen_suite.training.recipes import (
    BCHyperparameters,
    PPOHyperparameters,
    Recipe,
    checked_changes,
    find_schedule,
)

SCHEDULE = find_schedule("kitchen", "ppo")
# All that can be in its range, whatever the other values are.
CONFIGS = (PPOHyperparameters(num_envs=2**16, mini_batches=1), BCHyperparameters(chunk=2**10), SCHEDULE)
FIELDS = [(config, field.name) for config in CONFIGS for field in dataclasses.fields(config)]


def beside(end, interval, is_int, outwards):
    """The number next to an end of a range: outside if it is `outwards`, else inside."""
    direction = (1 if end == interval.high else -1) * (1 if outwards else -1)
    return end + direction if is_int else math.nextafter(end, direction * math.inf)


def changed(config, name, value):
    """The configuration with a value, through JSON, as commands give it; of a tuple as its only element."""
    value = [value] if isinstance(getattr(config, name), tuple) else value
    found = getattr(checked_changes(config, {name: json.loads(json.dumps(value))}), name)
    return found[0] if isinstance(found, tuple) else found


@pytest.mark.parametrize("config", CONFIGS, ids=lambda config: type(config).__name__)
def test_each_hyperparameter_has_a_range_with_its_default(config):
    defaults = dataclasses.asdict(config)
    assert defaults.keys() == ranges(type(config)).keys()
    for name, interval in ranges(type(config)).items():
        values = defaults[name] if isinstance(defaults[name], tuple) else (defaults[name],)
        assert all(value in interval for value in values), name


def test_numbers_and_arrays_of_numpy_are_taken_as_those_of_python():
    given = {"num_envs": np.int64(8), "learning_rate": np.float32(0.5), "hidden": np.array([4, 6])}
    made = checked_changes(PPOHyperparameters(), given)
    assert json.dumps([made.num_envs, made.learning_rate, made.hidden]) == "[8, 0.5, [4, 6]]"


@pytest.mark.parametrize(("config", "name"), FIELDS, ids=[name for _, name in FIELDS])
def test_both_ends_of_a_range_are_kept_and_what_is_beyond_is_refused(config, name):
    interval = ranges(type(config))[name]
    value = getattr(config, name)
    is_int = isinstance(value[0] if isinstance(value, tuple) and value else value, int)
    for end, is_open in ((interval.low, interval.open_low), (interval.high, interval.open_high)):
        least_outside = end if is_open else beside(end, interval, is_int, outwards=True)
        last_inside = beside(end, interval, is_int, outwards=False) if is_open else end
        assert changed(config, name, last_inside) == last_inside
        with refused(ValueError, name, f"must be in {interval}", repr(least_outside)):
            changed(config, name, least_outside)
    with refused(ValueError, name, str(interval)):
        changed(config, name, 10**400 if is_int else math.nan)
    for value in ("fast", True, None, *([2.5] if is_int else [])):
        with refused(TypeError, name, str(interval), repr(value)):
            changed(config, name, value)


# What a person would expect of those that are most often changed, to compare the table of ranges with.
EXPECTED = {
    "learning_rate": ([1e-9, 1e30], [0, -1e-3, math.inf]),
    "discount": ([1e-3, 1], [0, 1.01]),
    "gae_lambda": ([0, 1], [-0.1, 1.1]),
    "averaging": ([0, 0.999], [1]),
    "noise_correlation": ([0, 0.999], [1]),
    "ratio_clip": ([1e-3, 1], [0, -0.1]),
    "entropy_scale": ([0, 0.01], [-0.01]),
    "gradient_norm": ([0, 100.0], [-1]),
    "kl_target": ([0, 1.0], [-0.1]),
    "exploration": ([0.01, 10], [0]),
    "standardisation_epsilon": ([1e-8, 1], [0]),
    "value_batches": ([0, 1], [-1]),
    "learning_epochs": ([1], [0]),
    "hidden": ([1, 2**14], [0, 2**14 + 1]),
    "action_scale": ([0.01, 2], [0, -1]),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_ranges_are_those_that_mean_something(name):
    inside, outside = EXPECTED[name]
    assert [changed(CONFIGS[0], name, value) for value in inside] == inside
    for value in outside:
        with refused(ValueError, name):
            changed(CONFIGS[0], name, value)


def test_lists_and_combinations_are_checked():
    with refused(TypeError, "hidden", "list", "64"):
        checked_changes(PPOHyperparameters(), {"hidden": 64})
    with refused(ValueError, "mini_batches 2", "25"):
        checked_changes(PPOHyperparameters(), {"num_envs": 5, "rollouts": 5, "mini_batches": 2})
    with refused(ValueError, "rollouts", "at least 2", "num_envs is 1"):
        checked_changes(PPOHyperparameters(), {"num_envs": 1, "rollouts": 1, "mini_batches": 1})
    with refused(ValueError, "executed", "8", "9"):
        checked_changes(BCHyperparameters(), {"executed": 9})
    with refused(ValueError, "'num_env'", "'num_envs'"):
        checked_changes(PPOHyperparameters(), {"num_env": 5})


# Of a domain of the test.
BAD = Recipe(hyperparameters={"discount": 0.0}, schedule={"eval_interval": 0})


def test_the_recipe_of_a_domain_is_checked_as_well(monkeypatch):
    domain = dataclasses.replace(suite.find_domain("kitchen"), training=f"{__name__}:BAD")
    monkeypatch.setitem(suite._domains, "kitchen", domain)
    with refused(ValueError, "discount must be in (0, 1], got 0.0"):
        PPOHyperparameters.for_domain("kitchen", {})
    with refused(ValueError, "eval_interval must be in [1, 1000000000000], got 0"):
        find_schedule("kitchen", "ppo")


def test_intervals_are_written_as_in_mathematics():
    assert str(Interval(0, 1, open_low=True)) == "(0, 1]"
    assert str(Interval(0, math.inf, open_high=True)) == "[0, inf)"


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


@pytest.mark.clients
def test_a_learner_of_the_least_hyperparameters_learns_and_is_exported():
    envs = environments(1, max_episode_steps=5)
    taught = learner(envs, **LEAST, action_scale=[0.01] * 8)
    rng = np.random.default_rng(0)
    size = taught.batch.observations.shape[-1]
    taught.imitate(
        rng.normal(size=(1, size)).astype(np.float32), rng.normal(size=(1, 8)).astype(np.float32), lambda loss: None
    )
    assert taught.warmup_batches == 0
    fresh = learner(envs, **LEAST, action_scale=[0.01] * 8)
    for each in (taught, fresh):
        each.start(0)
        for _ in range(3):
            assert np.isfinite([*each.learn().values()]).all()
        assert each.export({}).layers == [size, 8]
    envs.close()

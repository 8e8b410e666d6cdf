"""Odd arguments of vectorised environments: a clear error, and nothing has changed."""

import gymnasium
import numpy as np
import pytest
from helpers.comparisons import assert_same
from helpers.errors import refused

from kitchen_suite.gymnasium_env import KITCHEN_ID
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv


@pytest.fixture(scope="module")
def built():
    return [FrankaOpenCabinetVectorEnv(3, num_threads=1, max_episode_steps=50) for _ in range(2)]


@pytest.fixture
def twins(built):
    """Two environments in the middle of the same episodes."""
    for env in built:
        env.reset(seed=7)
        env.step(np.zeros((3, 8)))
    return built


def assert_goes_on_as(env, twin):
    for scale in (0.0, 0.01):
        action = np.full((3, 8), scale)
        assert_same(env.step(action), twin.step(action))
    assert_same(env.reset(), twin.reset())


def spoilt(value):
    array = np.zeros((3, 8))
    array[1, 2] = value
    return array


# For each kind of bad actions: what the error shows.
BAD_ACTIONS = {
    "of one environment": (np.zeros(8), ValueError, ["actions", "(3, 8)", "(8,)"]),
    "of another robot": (np.zeros((3, 9)), ValueError, ["actions", "(3, 8)", "(3, 9)"]),
    "one number": (0.5, ValueError, ["actions"]),
    "NaN": (spoilt(np.nan), ValueError, ["actions", "finite", "[1]"]),
    "beyond doubles": (np.full((3, 8), np.longdouble("1e400")), ValueError, ["actions", "finite", "[0, 1, 2]"]),
    "strings": ([["up"] * 8] * 3, TypeError, ["actions", "numbers"]),
    "bools": (np.ones((3, 8), bool), TypeError, ["actions", "numbers"]),
    "ragged": ([[0.0], [0.0] * 8, []], ValueError, ["actions", "array"]),
}


@pytest.mark.parametrize(("actions", "error", "shown"), BAD_ACTIONS.values(), ids=BAD_ACTIONS.keys())
@pytest.mark.filterwarnings("ignore:overflow encountered in cast")
def test_bad_actions_are_refused_and_change_nothing(twins, actions, error, shown):
    env, twin = twins
    with refused(error, *shown):
        env.step(actions)
    assert_goes_on_as(env, twin)


MASK = np.array([True, False, False])
BAD_RESETS = {
    "negative seed among others": ({"seed": [1, 2, -3]}, ValueError, ["seed", "-3"]),
    "float among the seeds": ({"seed": [1, 2.5, None]}, TypeError, ["seed", "2.5"]),
    "text for seeds": ({"seed": "123"}, TypeError, ["seed", "'123'"]),
    "array without an axis": ({"seed": np.array(3)}, TypeError, ["seed", "array(3)"]),
    "too few seeds": ({"seed": [1, 2]}, ValueError, ["seed", "3", "2"]),
    "option of single environments": ({"options": {"state": 1}}, ValueError, ["'state'"]),
    "misspelt option": ({"options": {"low": 0, "reset_mas": MASK}}, ValueError, ["'reset_mas'", "'reset_mask'"]),
    "list for a mask": ({"options": {"reset_mask": [True, False, True]}}, TypeError, ["reset_mask", "bools"]),
    "mask of ints": ({"options": {"reset_mask": np.array([1, 0, 0])}}, TypeError, ["reset_mask", "bools"]),
    "short mask": ({"options": {"reset_mask": MASK[:2]}}, ValueError, ["reset_mask", "(3,)", "(2,)"]),
    "mask that chooses nothing": ({"options": {"reset_mask": ~MASK & MASK}}, ValueError, ["reset_mask", "one"]),
    "good mask and a bad seed": ({"seed": -1, "options": {"reset_mask": MASK}}, ValueError, ["seed", "-1"]),
    "good seed and a bad mask": ({"seed": 3, "options": {"reset_mask": MASK[:2]}}, ValueError, ["reset_mask"]),
}


@pytest.mark.parametrize("seeds", [range(4, 7), (4, 5, 6), np.arange(4, 7), np.uint8(4)])
def test_seeds_of_any_sequence_are_those_of_a_list(twins, seeds):
    env, twin = twins
    assert_same(env.reset(seed=seeds), twin.reset(seed=[4, 5, 6]))
    assert_goes_on_as(env, twin)


def test_options_of_other_libraries_are_ignored(twins):
    env, twin = twins
    options = {"lerobot_new_rollout": True, "low": -1.0}
    np.testing.assert_equal(env.reset(seed=4, options=options), twin.reset(seed=4))
    np.testing.assert_equal(
        env.reset(seed=5, options={**options, "reset_mask": MASK}), twin.reset(seed=5, options={"reset_mask": MASK})
    )
    assert_goes_on_as(env, twin)


@pytest.mark.parametrize(("arguments", "error", "shown"), BAD_RESETS.values(), ids=BAD_RESETS.keys())
def test_bad_seeds_and_options_are_refused_and_change_nothing(twins, arguments, error, shown):
    env, twin = twins
    seeds = env.np_random_seed
    with refused(error, *shown):
        env.reset(**arguments)
    assert env.np_random_seed == seeds
    assert_goes_on_as(env, twin)


def test_empty_options_and_masks_of_all_reset_all(twins):
    env, twin = twins
    for options in ({}, {"reset_mask": np.full(3, True)}):
        assert_same(env.reset(options=options), twin.reset())


@pytest.mark.parametrize(
    ("arguments", "error", "shown"),
    [
        ({"num_envs": 0}, ValueError, ["num_envs", "1", "0"]),
        ({"num_envs": 2.0}, TypeError, ["num_envs"]),
        ({"num_threads": 0}, ValueError, ["num_threads", "1", "0"]),
        ({"autoreset_mode": "NextStp"}, ValueError, ["autoreset_mode", "'NextStp'", "'NextStep'"]),
        ({"max_episode_steps": 0}, ValueError, ["max_episode_steps", "1"]),
        ({"render_mode": "human"}, ValueError, ["render_mode", "'human'", "'rgb_array'"]),
        ({"render_mode": "rgb_arry"}, ValueError, ["render_mode", "'rgb_arry'", "'rgb_array'"]),
        ({"threshold": -1.0}, ValueError, ["threshold"]),
        ({"tasks_to_complete": ["ketle"]}, ValueError, ["'kettle'"]),
        ({"colour": "red"}, TypeError, ["colour"]),
        ({"vector_kwargs": {"copy": False}}, TypeError, ["vector_kwargs"]),
    ],
)
def test_bad_arguments_are_refused(arguments, error, shown):
    with refused(error, *shown):
        FrankaKitchenVectorEnv(**arguments)


def test_bad_arguments_reach_make_vec_as_clear_errors():
    with refused(ValueError, "num_threads", "1"):
        gymnasium.make_vec(KITCHEN_ID, num_envs=2, num_threads=0)
    with pytest.raises(TypeError, match="colour"):
        gymnasium.make_vec(KITCHEN_ID, num_envs=2, colour="red")


@pytest.mark.full
@pytest.mark.parametrize("vector", [FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv])
def test_a_step_wants_a_reset_before_it(vector):
    env = vector(2, num_threads=1)
    actions = np.zeros(env.action_space.shape)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(actions)
    with pytest.raises(gymnasium.error.ResetNeeded, match="all of them first"):
        env.reset(options={"reset_mask": np.array([True, False])})
    env.reset(seed=0, options={"reset_mask": np.array([True, True])})
    twin = vector(2, num_threads=1)
    twin.reset(seed=0)
    assert_same(env.step(actions), twin.step(actions))


def test_a_step_of_an_ended_episode_is_refused_and_changes_nothing():
    env, twin = (
        FrankaOpenCabinetVectorEnv(3, max_episode_steps=2, autoreset_mode="Disabled", num_threads=1) for _ in range(2)
    )
    for each in (env, twin):
        each.reset(seed=0)
        each.step(np.zeros((3, 8)))
        each.reset(options={"reset_mask": MASK})
        each.step(np.zeros((3, 8)))
    with refused(gymnasium.error.ResetNeeded, "[1, 2]"):
        env.step(np.ones((3, 8)))
    for each in (env, twin):
        each.reset(options={"reset_mask": ~MASK})
    assert_same(env.step(np.zeros((3, 8))), twin.step(np.zeros((3, 8))))

"""Bad input raises an error that names the argument, its value and the values allowed, and changes nothing."""

import sys
from importlib import util

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.entities import Kettle, KitchenArena, Microwave, assets
from kitchen_suite.environment import Environment
from kitchen_suite.environment.random_states import make_random_state

NAN, INF = float("nan"), float("inf")


def load(domain="kitchen", task="all", environment_kwargs=None, **task_kwargs):
    return suite.load(domain, task, {"visuals": False, "random": 0, **task_kwargs}, environment_kwargs)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"domain": "kitchn"}, ValueError, ["domain 'kitchn'", "did you mean 'kitchen'", "choose from"]),
        ({"task": "microwav"}, ValueError, ["'microwav'", "did you mean 'microwave'", "'kitchen'"]),
        ({"tasks_to_complete": ["toaster"]}, ValueError, ["'toaster'", "choose from", "'kettle'"]),
        ({"tasks_to_complete": []}, ValueError, ["tasks_to_complete", "empty"]),
        ({"tasks_to_complete": "kettle"}, TypeError, ["tasks_to_complete", "'kettle'"]),
        ({"goals": {"microwave": [1.0, 2.0]}}, ValueError, ["goal of 'microwave'", "(1,)", "(2,)"]),
        ({"goals": {"microwave": [-1e200]}}, ValueError, ["goal of 'microwave'", "1e+10", "-1.e+200"]),
        ({"goals": {"micro": [1.0]}}, ValueError, ["'micro'", "did you mean 'microwave'"]),
        ({"goals": [1.0]}, TypeError, ["goals", "[1.0]"]),
        ({"task": "kettle", "goals": {"microwave": [0.1]}}, ValueError, ["'microwave'", "['kettle']"]),
        ({"robot_noise_ratio": -0.1}, ValueError, ["robot_noise_ratio", "-0.1", "non-negative"]),
        ({"object_noise_ratio": INF}, ValueError, ["object_noise_ratio", "inf", "finite"]),
        ({"velocity_scale": NAN}, ValueError, ["velocity_scale", "nan"]),
        ({"threshold": -1.0}, ValueError, ["threshold", "-1.0"]),
        ({"feedback": "observd"}, ValueError, ["feedback", "did you mean 'observed'", "target"]),
        ({"terminate_on_tasks_completed": 1}, TypeError, ["terminate_on_tasks_completed", "1"]),
        ({"remove_task_when_completed": "no"}, TypeError, ["remove_task_when_completed", "'no'"]),
        ({"visuals": "no"}, TypeError, ["visuals", "'no'"]),
        ({"time_limit": 0}, ValueError, ["time_limit", "positive", "0"]),
        ({"time_limit": INF}, ValueError, ["time_limit", "inf"]),
        ({"random": -1}, ValueError, ["random", "-1"]),
        ({"random": "lucky"}, TypeError, ["random", "'lucky'"]),
        ({"tasks": ["kettle"]}, TypeError, ["tasks"]),
        ({"environment_kwargs": {"flat": True}}, TypeError, ["flat"]),
        ({"environment_kwargs": {"flat_observation": "no"}}, TypeError, ["flat_observation", "'no'"]),
        ({"environment_kwargs": 3}, TypeError, ["environment_kwargs", "3"]),
        ({"domain": "open_cabinet", "task": "top_drawer", "drawer": "bottom"}, ValueError, ["top_drawer", "drawer"]),
    ],
)
def test_arguments(arguments, error, words):
    with refused(error, *words):
        load(**arguments)


def test_environment_kwargs_are_no_task_kwargs():
    with refused(TypeError, "environment_kwargs"):
        suite.load("kitchen", "all", {"environment_kwargs": {"flat_observation": True}})
    with refused(TypeError, "task_kwargs"):
        suite.load("kitchen", "all", 3)


@pytest.mark.full
def test_visualize_reward_must_be_a_bool():
    with refused(TypeError, "visualize_reward"):
        suite.load("kitchen", "all", {"visuals": False}, visualize_reward="yes")


@pytest.fixture(scope="module")
def twins():
    return load(), load()


@pytest.mark.parametrize(
    ("action", "error", "words"),
    [
        (np.zeros(8), ValueError, ["action", "(9,)", "(8,)"]),
        ([NAN] * 9, ValueError, ["action", "finite", "nan"]),
        (["up"] * 9, TypeError, ["action", "numbers"]),
    ],
)
def test_actions_change_nothing(twins, action, error, words):
    tried, spared = twins
    for environment in twins:
        environment.random_state = 0
        environment.reset()
    with refused(error, *words):
        tried.step(action)
    for _ in range(3):
        one, other = tried.step(np.ones(9)), spared.step(np.ones(9))
        for key, value in one.observation.items():
            np.testing.assert_array_equal(value, other.observation[key])


@pytest.mark.parametrize(("domain", "task", "size"), [("kitchen", "all", 9), ("open_cabinet", "top_drawer", 8)])
@pytest.mark.filterwarnings("error")
def test_a_longdouble_action_beyond_float64_is_refused_without_numpys_warning(domain, task, size):
    environment = load(domain, task)
    environment.reset()
    with pytest.raises(ValueError, match="action must be finite"):
        environment.step(np.full(size, np.longdouble("1e400")))


@pytest.mark.full
@pytest.mark.parametrize("action", [[0] * 9, (0.5,) * 9, np.ones(9, np.float32), np.ones(9, np.int8)])
def test_actions_of_any_real_type_are_taken(action):
    environment = load()
    environment.reset()
    assert environment.step(action).mid()


def test_the_environment_refuses_a_time_limit_that_is_not_positive():
    with refused(ValueError, "time_limit", "0"):
        Environment(load().task, time_limit=0)


def test_random_takes_numpys_integers():
    assert make_random_state(np.int64(3)).uniform() == np.random.RandomState(3).uniform()


def test_the_arena_lists_its_sites():
    toaster = Microwave(visuals=False, name="toaster")
    with refused(ValueError, "'toaster'", "'microwave'"):
        KitchenArena(visuals=False).attach_at_site(toaster)


def test_without_gymnasium_robotics_the_error_says_what_to_install(monkeypatch):
    find_spec = util.find_spec
    monkeypatch.setattr(
        util, "find_spec", lambda name, *args: None if name == "gymnasium_robotics" else find_spec(name, *args)
    )
    with refused(FileNotFoundError, "'gymnasium-robotics>=1.4,<1.5'"):
        Kettle()


def test_a_gymnasium_robotics_without_the_assets_is_named_too(monkeypatch, tmp_path):
    (tmp_path / "gymnasium_robotics").mkdir()
    (tmp_path / "gymnasium_robotics" / "__init__.py").touch()
    monkeypatch.delitem(sys.modules, "gymnasium_robotics", raising=False)
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    with refused(FileNotFoundError, "kitchen_franka", "gymnasium-robotics>=1.4,<1.5"):
        assets.asset_dir()

"""Environments have the methods of a goal environment only where their observations hold goals."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.suite import DOMAINS
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

METHODS = ("compute_reward", "compute_terminated", "compute_truncated")
SMALL = {"image_size": (16, 16), "render_quality": "fast"}
# The observation types of all domains.
CASES = [(name, obs_type) for name, domain in DOMAINS.items() for obs_type in domain.env_class.obs_types]


def arguments_of(obs_type):
    return {"obs_type": obs_type, **(SMALL if "pixels" in obs_type else {})}


def holds_goals(space):
    return isinstance(space, spaces.Dict) and {"achieved_goal", "desired_goal"} <= space.spaces.keys()


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "obs_type"),
    [
        pytest.param(
            *case.values, marks=(*case.marks, *([pytest.mark.rendering] if "pixels" in case.values[1] else []))
        )
        for case in brief(CASES, [case for case in CASES if case[0] == "kitchen" or "pixels" not in case[1]])
    ],
)
def test_single_and_vectorised_environments_are_goal_environments_where_goals_are_observed(domain, obs_type):
    record = DOMAINS[domain]
    wrapped = gymnasium.make(record.env_id, **arguments_of(obs_type))
    many = gymnasium.make_vec(record.env_id, 2, num_threads=1, **arguments_of(obs_type))
    for environment, space in (
        (wrapped.unwrapped, wrapped.observation_space),
        (many.unwrapped, many.single_observation_space),
    ):
        expected = holds_goals(space)
        assert [hasattr(environment, name) for name in METHODS] == [expected] * 3
    assert [wrapped.has_wrapper_attr(name) for name in METHODS] == [holds_goals(wrapped.observation_space)] * 3
    many.close()
    wrapped.close()


@pytest.mark.full
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("obs_type", ["goal", "state"])
def test_copies_have_the_same_methods(obs_type, copied):
    environment = copied(FrankaKitchenEnv(obs_type=obs_type))
    assert [hasattr(environment, name) for name in METHODS] == [obs_type == "goal"] * 3


@pytest.mark.full
@pytest.mark.parametrize("make", [FrankaKitchenEnv, lambda **options: FrankaKitchenVectorEnv(1, **options)])
def test_the_error_names_the_observation_type_which_has_them(make):
    with refused(AttributeError, "compute_reward", "obs_type='goal'"):
        _ = make(obs_type="state").compute_reward
    assert callable(make(obs_type="goal").compute_reward)


@pytest.mark.full
def test_a_class_of_a_user_may_extend_the_reward():
    class Doubled(FrankaKitchenEnv):
        def compute_reward(self, achieved_goal, desired_goal, info):
            return 2.0 * super().compute_reward(achieved_goal, desired_goal, info)

    environment = Doubled(goal_format="flat")
    goal = environment.observation_space["desired_goal"].sample()
    assert environment.compute_reward(goal, goal, {}) == 2.0 * FrankaKitchenEnv().compute_reward(goal, goal, {}) > 0.0


@pytest.mark.full
@pytest.mark.parametrize("tasks", [["microwave"], ["kettle", "top burner"]])
@pytest.mark.parametrize("goal_format", ["dict", "flat"])
def test_goals_of_the_spaces_are_those_that_the_methods_take(goal_format, tasks):
    environment = FrankaKitchenEnv(tasks, goal_format=goal_format, max_episode_steps=10)
    many = FrankaKitchenVectorEnv(3, num_threads=1, tasks_to_complete=tasks, goal_format=goal_format)
    single, batch = environment.observation_space, many.observation_space
    for name, dtype in zip(METHODS, (np.float64, np.bool_, np.bool_), strict=True):
        info = {"episode_step": 1}
        one = getattr(environment, name)(single["achieved_goal"].sample(), single["desired_goal"].sample(), info)
        assert np.asarray(one).dtype == dtype
        assert np.asarray(one).shape == ()
        rows = getattr(many, name)(batch["achieved_goal"].sample(), batch["desired_goal"].sample(), [info] * 3)
        assert rows.dtype == dtype
        assert rows.shape == (3,)
    many.close()

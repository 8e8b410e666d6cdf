"""Subclasses of NumPy's arrays mean what plain arrays mean, in all front ends; masked entries are refused in all."""

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.episodes.play import play
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.policies import PolicyError
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

COUNT, SIZE = 2, 9
MASK = np.arange(SIZE) == 3


class Subclass(np.ndarray):
    """An array of which every sum, product, minimum and so on is 0."""

    def __array_ufunc__(self, function, method, *inputs, out=None, **arguments):
        plain = [each.view(np.ndarray) if isinstance(each, Subclass) else each for each in inputs]
        return 0.0 * getattr(function, method)(*plain, **arguments)


def masked(values, mask):
    return np.ma.array(values, mask=np.broadcast_to(mask, np.shape(values)))


# Arrays of other classes that hold the same numbers as plain ones.
SAME = {"masked": lambda values: masked(values, False), "subclass": lambda values: np.array(values).view(Subclass)}


def actions(shape=(SIZE,)):
    return np.random.default_rng(0).uniform(-1.0, 1.0, shape)


FRONT_ENDS = ["dm_env", "single", "vectorised"]


def stepped(front_end, action, domain="kitchen"):
    """The numbers that are observed after a step from a seed."""
    record = suite.DOMAINS[domain]
    if front_end == "dm_env":
        env = suite.load(domain, record.default_task, {"random": 0, "visuals": False})
        env.reset()
        return np.concatenate([*env.step(action).observation.values()])
    if front_end == "single":
        env = record.env_class(domain=domain)
    else:
        env = record.vector_env_class(COUNT, domain=domain, num_threads=1)
    env.reset(seed=0)
    observation = env.step(action)[0]
    return observation["observation"] if isinstance(observation, dict) else observation


@pytest.mark.full
@pytest.mark.parametrize("front_end", FRONT_ENDS)
@pytest.mark.parametrize("kind", SAME)
@pytest.mark.parametrize(("domain", "size"), [("kitchen", 9), ("open_cabinet", 8), ("pick_and_place", 9)])
def test_actions_of_another_class_mean_what_plain_ones_do(domain, size, kind, front_end):
    plain = 0.1 * actions((COUNT, size) if front_end == "vectorised" else (size,))
    observation = stepped(front_end, SAME[kind](plain), domain)
    np.testing.assert_array_equal(observation, stepped(front_end, plain, domain))
    assert type(observation) is np.ndarray


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_masked_actions_are_refused_and_filled_ones_taken(front_end):
    plain = masked(actions((COUNT, SIZE) if front_end == "vectorised" else (SIZE,)), MASK)
    with refused(ValueError, "action", "masked entries", "filled"):
        stepped(front_end, plain)
    observation = stepped(front_end, plain.filled(0.0))
    np.testing.assert_array_equal(observation, stepped(front_end, np.where(MASK, 0.0, plain.data)))


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@pytest.mark.parametrize("vector", [FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv])
def test_a_matrix_of_actions_is_as_an_array_and_leaves_a_vector_in_order(vector):
    env = vector(COUNT, num_threads=1)
    plain = 0.1 * actions(env.action_space.shape)
    env.reset(seed=0)
    expected = [env.step(plain)[0] for _ in range(2)]
    env.reset(seed=0)
    for observation in expected:
        np.testing.assert_equal(env.step(np.asmatrix(plain))[0], observation)


@pytest.mark.full
def test_masked_actions_that_are_refused_change_nothing():
    env, same = (FrankaKitchenVectorEnv(COUNT, num_threads=1) for _ in range(2))
    plain = actions((COUNT, SIZE))
    for each in (env, same):
        each.reset(seed=0)
    for wrong in (masked(plain, MASK), [masked(row, MASK) for row in plain]):
        with refused(ValueError, "actions", "masked entries"):
            env.step(wrong)
    np.testing.assert_array_equal(env.step(plain)[0]["observation"], same.step(plain)[0]["observation"])


@pytest.mark.full
def test_masked_entries_are_refused_wherever_an_environment_takes_arrays():
    env, envs = FrankaKitchenEnv(), FrankaKitchenVectorEnv(COUNT, num_threads=1)
    observation, info = env.reset(seed=0)
    goal = masked(observation["achieved_goal"]["microwave"], True)
    with refused(ValueError, "achieved_goal['microwave']", "masked entries"):
        env.compute_reward({**observation["achieved_goal"], "microwave": goal}, observation["desired_goal"], info)
    state = env.get_state()
    physics = masked(state["physics"], np.arange(state["physics"].size) == 1)
    with refused(ValueError, "state['physics']", "masked entries"):
        env.set_state({**state, "physics": physics})
    with refused(ValueError, "seed", "masked entries"):
        envs.reset(seed=np.ma.array([3, 4], mask=[False, True]))
    envs.reset(seed=0)
    with refused(ValueError, "reset_mask", "masked entries"):
        envs.reset(options={"reset_mask": np.ma.array([True, True], mask=[False, True])})
    assert envs.np_random_seed == (0, 1)


def test_masked_entries_of_a_saved_random_state_are_refused():
    env = suite.load("kitchen", "all", {"random": 0, "visuals": False})
    env.reset()
    state = env.get_state()
    key = masked(state["random"]["state"]["key"], np.arange(624) == 5)
    random = {**state["random"], "state": {**state["random"]["state"], "key": key}}
    with refused(ValueError, "state['random']['state']['key']", "masked entries"):
        env.set_state({**state, "random": random})


@pytest.mark.full
@pytest.mark.parametrize("takes", ["timestep", "batch"])
def test_a_policy_whose_action_has_masked_entries_is_told_so(takes):
    shape = (COUNT, SIZE) if takes == "batch" else (SIZE,)
    spec = EnvironmentSpec.make("kitchen", "microwave", None, max_episode_steps=3)
    with pytest.raises(PolicyError, match="masked entries"):
        [*play(spec, lambda seen: masked(np.zeros(shape), MASK), [0, 1], takes=takes, num_envs=COUNT)]

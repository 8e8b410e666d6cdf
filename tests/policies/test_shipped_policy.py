"""The policies that come with the package open the drawer, whichever way they are played; one of them by a grasp."""

import cabinet_expert
import gymnasium
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.policies import find
from kitchen_suite.policies.trained import TrainedPolicy, shipped_as
from kitchen_suite.rollouts.episode import play

CABINET = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1"

# By the reward they were trained for.
POLICIES = {"original": "top_drawer", "grasp": "top_drawer_grasp"}

# Training and its evaluations take theirs from 500,000,000 on.
UNSEEN = 30_000


def load(reward):
    return suite.load("open_cabinet", "top_drawer", task_kwargs={"visuals": False, "reward": reward})


def through_suite(reward, count):
    with load(reward) as environment:
        build = find("trained")
        outcomes = [play(environment, build, seed).outcome for seed in range(UNSEEN, UNSEEN + count)]
    return [outcome.results["success"] for outcome in outcomes]


def through_gymnasium(reward, count):
    policy = TrainedPolicy.load(shipped_as(POLICIES[reward]))
    successes = []
    with gymnasium.make(CABINET, reward=reward) as environment:
        for seed in range(UNSEEN, UNSEEN + count):
            observation, info = environment.reset(seed=seed)
            ended = False
            while not ended:
                observation, _, terminated, truncated, info = environment.step(policy(observation))
                ended = terminated or truncated
            successes.append(bool(info["is_success"]))
    return successes


def through_vector(reward, count):
    policy = TrainedPolicy.load(shipped_as(POLICIES[reward]))
    kind = gymnasium.VectorizeMode.VECTOR_ENTRY_POINT
    environments = gymnasium.make_vec(CABINET, num_envs=count, vectorization_mode=kind, reward=reward)
    observations, infos = environments.reset(seed=UNSEEN)
    ended, successes = np.zeros(count, bool), np.zeros(count, bool)
    while not ended.all():
        observations, _, terminations, truncations, infos = environments.step(policy(observations))
        ending = (terminations | truncations) & ~ended
        successes[ending] = infos["is_success"][ending]
        ended |= ending
    environments.close()
    return successes.tolist()


REWARDS = pytest.mark.parametrize("reward", POLICIES)
WAYS = pytest.mark.parametrize("way", [through_suite, through_gymnasium, through_vector])


@REWARDS
@WAYS
def test_it_opens_the_drawer(way, reward):
    assert sum(way(reward, 5)) >= 4


@pytest.mark.slow
@REWARDS
@WAYS
def test_it_opens_the_drawer_nearly_always(way, reward):
    assert sum(way(reward, 100)) >= 98


def shares_held(reward, count):
    """Of each episode the share of the pulling steps with both pads on the bar."""
    build, shares = find("trained"), []
    with load(reward) as environment:
        for seed in range(UNSEEN, UNSEEN + count):
            environment.random_state = seed
            opening, share, _ = cabinet_expert.pulling_episode(
                environment, lambda env: build(env, np.random.default_rng(0))
            )
            assert opening > 0.1
            shares.append(share)
    return shares


def test_the_one_paid_for_grasping_pulls_with_both_pads():
    assert np.mean(shares_held("grasp", 3)) >= 0.8


def test_the_other_one_drags():
    assert np.mean(shares_held("original", 3)) < 0.5


@pytest.mark.slow
def test_the_one_paid_for_grasping_pulls_with_both_pads_in_twenty_episodes():
    shares = shares_held("grasp", 20)
    assert np.mean(shares) >= 0.8
    assert np.median(shares) >= 0.8


@pytest.mark.parametrize("name", POLICIES.values())
def test_it_acts_without_chance(name):
    policy = TrainedPolicy.load(shipped_as(name))
    observations = np.random.default_rng(0).uniform(-1, 1, (4, policy.observation_size)).astype(np.float32)
    assert np.array_equal(policy(observations), policy(observations))
    assert policy(observations).std(axis=0).min() > 0

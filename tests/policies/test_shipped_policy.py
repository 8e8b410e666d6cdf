"""The policies that come with the package open the drawer in all kinds of environments; one of them grasps it."""

import contextlib

import gymnasium
import numpy as np
import pytest
from helpers import open_cabinet
from helpers.episodes import successes, successes_together
from helpers.vectors import many

from kitchen_suite import suite
from kitchen_suite.policies import find
from kitchen_suite.policies.files import shipped_as
from kitchen_suite.policies.perceptron import PerceptronPolicy

CABINET = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1"

# Names of the policies, by the reward that they were trained for.
POLICIES = {"original": "top_drawer", "grasp": "top_drawer_grasp"}

# First of the seeds; training and its evaluations take theirs from 500,000,000 on.
UNSEEN = 30_000


def load(reward):
    return suite.load("open_cabinet", "top_drawer", task_kwargs={"visuals": False, "reward": reward})


def through_suite(reward, count):
    with load(reward) as environment:
        return successes(environment, range(UNSEEN, UNSEEN + count), "trained")


def through_gymnasium(reward, count):
    policy = PerceptronPolicy.load(shipped_as(POLICIES[reward]))
    found = 0
    with gymnasium.make(CABINET, reward=reward) as environment:
        for seed in range(UNSEEN, UNSEEN + count):
            observation, info = environment.reset(seed=seed)
            ended = False
            while not ended:
                observation, _, terminated, truncated, info = environment.step(policy(observation))
                ended = terminated or truncated
            found += info["is_success"]
    return found


def through_vector(reward, count):
    policy = PerceptronPolicy.load(shipped_as(POLICIES[reward]))
    with contextlib.closing(many(CABINET, count, reward=reward)) as environments:
        return successes_together(environments, policy, UNSEEN)


REWARDS = pytest.mark.parametrize("reward", POLICIES)
ENVIRONMENTS = pytest.mark.parametrize("play_episodes", [through_suite, through_gymnasium, through_vector])


@pytest.mark.full
@pytest.mark.parametrize(
    ("play_episodes", "reward"),
    [
        pytest.param(through_suite, "original", marks=pytest.mark.nightly),
        pytest.param(through_suite, "grasp", marks=pytest.mark.nightly),
        pytest.param(through_gymnasium, "original", marks=pytest.mark.nightly),
        (through_gymnasium, "grasp"),
        (through_vector, "original"),
        pytest.param(through_vector, "grasp", marks=pytest.mark.nightly),
    ],
)
def test_it_opens_the_drawer(play_episodes, reward):
    assert play_episodes(reward, 5) >= 4


@pytest.mark.nightly
@REWARDS
@ENVIRONMENTS
def test_it_opens_the_drawer_nearly_always(play_episodes, reward):
    assert play_episodes(reward, 100) >= 98


def grasp_fractions(reward, count):
    """For each episode, the fraction of the pulling steps with both pads on the bar."""
    build, fractions = find("trained"), []
    with load(reward) as environment:
        for seed in range(UNSEEN, UNSEEN + count):
            environment.random_state = seed
            opening, fraction, _ = open_cabinet.pulling_episode(
                environment, lambda env: build(env, np.random.default_rng(0))
            )
            assert opening > 0.1
            fractions.append(fraction)
    return fractions


@pytest.mark.full
def test_the_policy_of_the_grasp_reward_pulls_with_both_pads():
    assert np.mean(grasp_fractions("grasp", 3)) >= 0.8


@pytest.mark.full
def test_the_policy_of_the_original_reward_drags():
    assert np.mean(grasp_fractions("original", 3)) < 0.5


@pytest.mark.nightly
def test_the_policy_of_the_grasp_reward_pulls_with_both_pads_in_twenty_episodes():
    fractions = grasp_fractions("grasp", 20)
    assert np.mean(fractions) >= 0.8
    assert np.median(fractions) >= 0.8


@pytest.mark.parametrize("name", POLICIES.values())
def test_actions_are_deterministic(name):
    policy = PerceptronPolicy.load(shipped_as(name))
    observations = np.random.default_rng(0).uniform(-1, 1, (4, policy.observation_size)).astype(np.float32)
    assert np.array_equal(policy(observations), policy(observations))
    assert policy(observations).std(axis=0).min() > 0

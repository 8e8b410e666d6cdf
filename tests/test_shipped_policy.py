"""The policy that comes with the package opens the drawer, whichever way it is played."""

import gymnasium
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.episodes import play
from kitchen_suite.policies import find
from kitchen_suite.trained_policy import SHIPPED, TrainedPolicy

CABINET = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1"

# Those of its training and of its demonstrations are others.
UNSEEN = 30_000


def through_suite(count):
    with suite.load("open_cabinet", "top_drawer", task_kwargs={"visuals": False}) as environment:
        build = find("trained")
        outcomes = [play(environment, build, seed).outcome for seed in range(UNSEEN, UNSEEN + count)]
    return [outcome.results["success"] for outcome in outcomes]


def through_gymnasium(count):
    policy = TrainedPolicy.load(SHIPPED / "top_drawer.npz")
    successes = []
    with gymnasium.make(CABINET) as environment:
        for seed in range(UNSEEN, UNSEEN + count):
            observation, info = environment.reset(seed=seed)
            ended = False
            while not ended:
                observation, _, terminated, truncated, info = environment.step(policy(observation))
                ended = terminated or truncated
            successes.append(bool(info["is_success"]))
    return successes


def through_vector(count):
    policy = TrainedPolicy.load(SHIPPED / "top_drawer.npz")
    environments = gymnasium.make_vec(CABINET, num_envs=count, vectorization_mode="vector_entry_point")
    observations, infos = environments.reset(seed=UNSEEN)
    # None may end early: what is shown at the last step is then that of the first episodes.
    for _ in range(environments.spec.max_episode_steps):
        observations, _, terminations, _, infos = environments.step(policy(observations))
        assert not terminations.any()
    environments.close()
    return infos["is_success"].tolist()


WAYS = pytest.mark.parametrize("way", [through_suite, through_gymnasium, through_vector])


@WAYS
def test_it_opens_the_drawer(way):
    assert sum(way(5)) >= 4


@pytest.mark.slow
@WAYS
def test_it_opens_the_drawer_nearly_always(way):
    assert sum(way(100)) >= 98


def test_it_acts_without_chance():
    policy = TrainedPolicy.load(SHIPPED / "top_drawer.npz")
    observations = np.random.default_rng(0).uniform(-1, 1, (4, policy.observation_size)).astype(np.float32)
    assert np.array_equal(policy(observations), policy(observations))
    assert policy(observations).std(axis=0).min() > 0

"""`episode_seeds` of vectorised environments: the k-th episode of environment i of n has the seed s + i + k n."""

import gymnasium
import numpy as np
import pytest
import tree
from gymnasium.utils.env_checker import data_equivalence
from helpers.comparisons import assert_same
from helpers.sweeps import brief
from helpers.vectors import batch

from kitchen_suite import suite

VARIED = {"variations": ["start", "dynamics"]}
COUNT = 3
MODES = ("NextStep", "SameStep", "Disabled")


def make_vec(domain="kitchen", **options):
    options = {"episode_seeds": True, "num_threads": 1, **VARIED, **options}
    return gymnasium.make_vec(suite.DOMAINS[domain].env_id, COUNT, vectorization_mode="vector_entry_point", **options)


def row(observations, i):
    return tree.map_structure(lambda array: array[i], observations)


def first(seed, domain="kitchen"):
    """Returns the first observation of the single environment after a reset with a seed."""
    return gymnasium.make(suite.DOMAINS[domain].env_id, **VARIED).reset(seed=seed)[0]


def starts(envs, mode, rounds):
    """Returns the first observations of episodes: a list for each environment, which end at different times."""
    observations, _ = envs.reset(seed=10)
    found, ended = [[row(observations, i)] for i in range(COUNT)], np.zeros(COUNT, bool)
    for _ in range(rounds):
        restarted = ended
        if mode == "Disabled" and ended.any():
            observations, _ = envs.reset(options={"reset_mask": ended})
        else:
            observations, _, terminations, truncations, _ = envs.step(np.zeros(envs.action_space.shape))
            ended = terminations | truncations
            restarted = ended if mode == "SameStep" else restarted if mode == "NextStep" else np.zeros(COUNT, bool)
        for i in np.flatnonzero(restarted):
            found[i].append(row(observations, i))
        if mode == "Disabled" and restarted.any():
            ended = np.zeros(COUNT, bool)
    return found


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "mode"),
    brief(
        [(d, m) for d in suite.DOMAINS for m in MODES],
        [("open_cabinet", "SameStep")],
        [(d, "SameStep") for d in suite.DOMAINS],
    ),
)
def test_episodes_have_the_seeds_that_no_other_has(domain, mode):
    envs = make_vec(domain, autoreset_mode=mode, max_episode_steps=2)
    found = starts(envs, mode, 8)
    assert min(map(len, found)) >= 3
    for i, episodes in enumerate(found):
        for k, observation in enumerate(episodes):
            assert_same(observation, first(10 + i + k * COUNT, domain))
    assert envs.unwrapped.np_random_seed == tuple(10 + i + (len(each) - 1) * COUNT for i, each in enumerate(found))


@pytest.mark.full
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_vector_of_single_environments_is_the_same_with_the_number_as_its_stride(mode):
    native = make_vec(autoreset_mode=mode, max_episode_steps=2, info_format="arrays")
    options = {"episode_seeds": COUNT, "max_episode_steps": 2, "info_format": "arrays", **VARIED}
    settings = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": gymnasium.vector.AutoresetMode(mode)}}
    single = gymnasium.make_vec(suite.DOMAINS["kitchen"].env_id, COUNT, **settings, **options)
    assert_same(native.reset(seed=4)[0], single.reset(seed=4)[0])
    for _ in range(6):
        actions = np.zeros(native.action_space.shape)
        assert_same(native.step(actions)[:4], single.step(actions)[:4])


@pytest.mark.full
def test_the_lengths_of_other_episodes_do_not_matter():
    envs = make_vec()
    envs.reset(seed=10)
    envs.step(np.zeros(envs.action_space.shape))
    # Environment 1 alone begins an episode more often than the others.
    for k in (1, 2):
        observations, _ = envs.reset(options={"reset_mask": np.array([False, True, False])})
        assert_same(row(observations, 1), first(11 + k * COUNT))
    observations, _ = envs.reset()
    for i, seed in enumerate((10 + COUNT, 11 + 3 * COUNT, 12 + COUNT)):
        assert_same(row(observations, i), first(seed))


@pytest.mark.full
def test_seeds_in_a_sequence_count_on_by_the_same_distance_and_none_continues():
    envs = make_vec()
    envs.reset(seed=[100, 50, 7])
    observations, _ = envs.reset(seed=[None, 9, None])
    for i, seed in enumerate((103, 9, 10)):
        assert_same(row(observations, i), first(seed))
    observations, _ = envs.reset()
    for i, seed in enumerate((106, 12, 13)):
        assert_same(row(observations, i), first(seed))


@pytest.mark.full
def test_a_number_is_the_distance_in_vectors_as_well():
    envs = make_vec(episode_seeds=1)
    envs.reset(seed=10)
    observations, _ = envs.reset()
    for i in range(COUNT):
        assert_same(row(observations, i), first(11 + i))


@pytest.mark.full
def test_the_episode_after_a_divergence_has_the_next_seed():
    envs = make_vec()
    envs.reset(seed=10)
    batch(envs).qvel[1, 0] = np.inf
    *_, infos = envs.step(np.zeros(envs.action_space.shape))
    assert infos["physics_error"].tolist() == [False, True, False]
    observations, *_ = envs.step(np.zeros(envs.action_space.shape))
    assert_same(row(observations, 1), first(11 + COUNT))


@pytest.mark.full
def test_by_default_streams_go_on():
    envs, plain = make_vec(episode_seeds=False), make_vec(episode_seeds=False)
    for env, steps in ((envs, 3), (plain, 7)):
        env.reset(seed=10)
        for _ in range(steps):
            env.step(np.zeros(envs.action_space.shape))
    one, other = envs.reset()[0], plain.reset()[0]
    assert not data_equivalence(one, other, exact=True)
    assert envs.unwrapped.np_random_seed == (10, 11, 12)

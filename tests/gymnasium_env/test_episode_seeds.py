"""`episode_seeds` of Gymnasium's environments: the k-th episode after a seed is that of the seed plus k."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from dm_control.rl import control
from gymnasium.utils.env_checker import check_env
from helpers.comparisons import assert_same
from helpers.errors import refused

from kitchen_suite import suite

VARIED = {"variations": ["start", "dynamics"]}
KITCHEN = suite.DOMAINS["kitchen"].env_id


def make(env_id=KITCHEN, **options):
    return gymnasium.make(env_id, **VARIED, **{"episode_seeds": True, **options})


def play(env, length, **options):
    """Returns the results of a reset and of a number of steps with the same actions."""
    results = [env.reset(**options)]
    results += [env.step(np.full(env.action_space.shape, 0.01)) for _ in range(length)]
    return results


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_an_episode_does_not_depend_on_the_lengths_of_those_before_it(domain):
    env_id = suite.DOMAINS[domain].env_id
    one, other = make(env_id), make(env_id)
    starts = [[play(env, n, **seed)[0] for n, seed in zip(lengths, ({"seed": 3}, {}, {}), strict=True)]
              for env, lengths in ((one, (3, 0, 1)), (other, (7, 4, 1)))]  # fmt: skip
    assert_same(*starts)
    assert one.unwrapped.np_random_seed == 5
    assert_same(starts[0][2], make(env_id, episode_seeds=False).reset(seed=5))


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_by_default_the_stream_goes_on(domain):
    env_id = suite.DOMAINS[domain].env_id
    one, other = make(env_id, episode_seeds=False), gymnasium.make(env_id, **VARIED)
    for env in (one, other):
        play(env, 2, seed=3)
        env.reset()
        assert env.unwrapped.np_random_seed == 3
        assert "next_seed" not in env.unwrapped.get_state()
    assert_same(play(one, 2), play(other, 2))


@pytest.mark.full
def test_a_number_is_the_distance_between_seeds():
    env = make(episode_seeds=4)
    env.reset(seed=1)
    start = env.reset()
    assert env.unwrapped.np_random_seed == 5
    assert_same(start, make().reset(seed=5))


@pytest.mark.full
def test_without_a_seed_a_drawn_one_counts_on():
    env = make()
    play(env, 2)
    drawn = env.unwrapped.np_random_seed
    start = env.reset()
    assert env.unwrapped.np_random_seed == drawn + 1
    assert_same(start, make().reset(seed=drawn + 1))


@pytest.mark.full
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("seed", [7, 2**100])
def test_copies_count_on(copied, seed):
    env = make().unwrapped
    play(env, 3, seed=seed)
    other = copied(env)
    assert_same([play(env, n) for n in (0, 2)], [play(other, n) for n in (0, 2)])
    assert env.np_random_seed == other.np_random_seed == seed + 2


@pytest.mark.full
def test_a_state_counts_on_and_a_seed_beside_it_counts_from_that():
    env, other = make(), make()
    play(env, 3, seed=7)
    state = env.unwrapped.get_state()
    play(other, 1, seed=30)
    other.reset(options={"state": state})
    assert other.unwrapped.np_random_seed == 7
    assert_same(play(env, 2), play(other, 2))
    assert other.unwrapped.np_random_seed == 8
    other.reset(seed=20, options={"state": state})
    assert other.unwrapped.np_random_seed == 20
    assert_same(other.reset(), make().reset(seed=21))


@pytest.mark.parametrize(("given", "second"), [(np.bool_(True), 6), (np.bool_(False), 5), (np.int64(3), 8)])
def test_the_stride_can_be_of_numpy(given, second):
    env = make(suite.DOMAINS["open_cabinet"].env_id, episode_seeds=given).unwrapped
    env.reset(seed=5)
    env.reset()
    assert env.np_random_seed == second


@pytest.mark.full
def test_the_episode_after_a_divergence_has_the_next_seed():
    env = make()
    env.reset(seed=7)
    env.unwrapped.environment.physics.data.qvel[0] = np.inf
    with pytest.raises(control.PhysicsError):
        env.step(np.zeros(9))
    observation, *_ = env.step(np.zeros(9))
    assert_same(observation, make().reset(seed=8)[0])
    assert_same(env.reset(), make().reset(seed=9))


@pytest.mark.full
def test_a_generator_that_was_assigned_has_one_episode_and_a_seed_is_the_remedy():
    env = make().unwrapped
    env.reset(seed=0)
    env.np_random = np.random.default_rng(4)
    plain = make(episode_seeds=False).unwrapped
    plain.np_random = np.random.default_rng(4)
    assert_same(env.reset(), plain.reset())
    before = env.get_state()
    with refused(ValueError, "episode_seeds", "seed to reset"):
        env.reset()
    assert_same(env.get_state(), before)
    assert_same(env.reset(seed=3), make().reset(seed=3))
    assert_same(env.reset(), make().reset(seed=4))


@pytest.mark.full
def test_a_refused_reset_does_not_count():
    env = make()
    env.reset(seed=3)
    with refused(TypeError, "variation_values"):
        env.reset(options={"variation_values": 3})
    assert_same(env.reset(), make().reset(seed=4))


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasiums_checker_is_content(domain):
    check_env(make(suite.DOMAINS[domain].env_id).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("value", ["yes", 1.0, 0, None])
def test_bad_values_are_refused(value):
    with refused((TypeError, ValueError), "episode_seeds"):
        make(episode_seeds=value)
    with refused((TypeError, ValueError), "episode_seeds"):
        gymnasium.make_vec(KITCHEN, 2, vectorization_mode="vector_entry_point", episode_seeds=value)


@pytest.mark.parametrize("copied", [lambda env: env, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_state_that_is_read_before_the_first_episode_skips_no_seed(copied):
    env = gymnasium.make(suite.DOMAINS["open_cabinet"].env_id, episode_seeds=True).unwrapped
    env.np_random = gymnasium.utils.seeding.np_random(5)[0]
    env._np_random_seed = 5
    env.get_state()
    first, _ = copied(env).reset()
    expected, _ = gymnasium.make(suite.DOMAINS["open_cabinet"].env_id, episode_seeds=True).unwrapped.reset(seed=5)
    np.testing.assert_array_equal(first, expected)

"""`episode_seeds` of `suite.load`: an episode depends on the seed and on its number, not on the episodes before it."""

import copy

import numpy as np
import pytest
from dm_control.rl import control
from helpers.errors import refused

from kitchen_suite import suite

VARIED = {"variations": ["start", "dynamics"], "visuals": False}


def load(domain="kitchen", **options):
    return suite.load(domain, suite.default_task(domain), {"random": 5, **VARIED, **options})


def zeros(environment):
    return np.zeros(environment.action_spec().shape)


def numbers(timestep):
    return np.concatenate([np.ravel(value) for value in timestep.observation.values()])


def play(environment, *lengths, reset=True):
    """Returns each episode's observations, the first `n` steps of it for each of some lengths."""
    episodes = []
    for length in lengths:
        timesteps = [environment.reset()] if reset else []
        timesteps += [environment.step(zeros(environment)) for _ in range(length)]
        episodes.append(np.stack([numbers(timestep) for timestep in timesteps]))
    return episodes


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_an_episode_does_not_depend_on_the_lengths_of_those_before_it(domain):
    short, long = (play(load(domain, episode_seeds=True), *lengths) for lengths in ((3, 0, 4), (7, 2, 4)))
    for one, other in zip(short, long, strict=True):
        count = min(len(one), len(other))
        np.testing.assert_array_equal(one[:count], other[:count])
    assert len({episode[0].tobytes() for episode in short}) == 3


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_episode_k_is_the_first_one_of_seed_plus_k(domain):
    episodes = play(load(domain, episode_seeds=True), 2, 0, 3)
    for k, episode in enumerate(episodes):
        np.testing.assert_array_equal(episode, play(load(domain, random=5 + k), len(episode) - 1)[0])


def test_a_number_is_the_distance_between_seeds():
    strided = play(load(episode_seeds=3), 1, 1)
    np.testing.assert_array_equal(strided[1], play(load(random=8), 1)[0])


@pytest.mark.full
def test_by_default_the_stream_goes_on():
    one, other = play(load(), 3, 0), play(load(), 7, 0)
    assert (one[1] != other[1]).any()
    assert "next_seed" not in load().get_state()


@pytest.mark.full
def test_it_may_be_an_environment_argument_as_well():
    task = suite.default_task("kitchen")
    environment = suite.load("kitchen", task, {"random": 5, **VARIED}, {"episode_seeds": True})
    for one, other in zip(play(environment, 2, 0), play(load(episode_seeds=True), 2, 0), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.full
def test_steps_that_start_episodes_count_as_resets():
    stepped, reset = load(episode_seeds=True, time_limit=0.24), load(episode_seeds=True)
    stepped.reset()
    while not stepped.step(zeros(stepped)).last():
        pass
    started = stepped.step(zeros(stepped))
    assert started.first()
    np.testing.assert_array_equal(numbers(started), play(reset, 0, 0)[1][0])


def test_the_episode_after_a_divergence_has_the_next_seed():
    environment = load(episode_seeds=True)
    environment.reset()
    environment.physics.data.qvel[0] = np.inf
    with pytest.raises(control.PhysicsError):
        environment.step(zeros(environment))
    started = environment.step(zeros(environment))
    np.testing.assert_array_equal(numbers(started), play(load(random=6), 0)[0][0])


def test_states_carry_the_seed_of_the_next_episode():
    one, other = load(episode_seeds=True), load(episode_seeds=True, random=90)
    play(one, 2, 2)
    state = copy.deepcopy(one.get_state())
    other.set_state(state)
    for each, again in zip(play(one, 0, 3), play(other, 0, 3), strict=True):
        np.testing.assert_array_equal(each, again)


@pytest.mark.full
def test_large_seeds_are_counted_exactly():
    environment = load(episode_seeds=True, random=2**100)
    environment.reset()
    other = load(episode_seeds=True)
    other.set_state(environment.get_state())
    np.testing.assert_array_equal(play(other, 0)[0], play(load(random=2**100 + 1), 0)[0])


@pytest.mark.full
def test_a_seed_set_later_is_that_of_the_next_episode():
    environment = load(episode_seeds=True)
    play(environment, 2)
    environment.random_state = 40
    for k, episode in enumerate(play(environment, 1, 2)):
        np.testing.assert_array_equal(episode, play(load(random=40 + k), len(episode) - 1)[0])


@pytest.mark.full
def test_without_a_seed_one_is_drawn():
    one, other = (play(load(episode_seeds=True, random=None), 0)[0] for _ in range(2))
    assert (one != other).any()


@pytest.mark.full
def test_a_stream_that_a_client_assigned_has_one_episode_and_a_seed_is_the_remedy():
    environment = load(episode_seeds=True)
    # As Shimmy does.
    environment._random_state = np.random.RandomState(7)
    np.testing.assert_array_equal(play(environment, 1)[0], play(load(random=7), 1)[0])
    with refused(ValueError, "episode_seeds", "random_state", "int"):
        environment.reset()
    environment.random_state = 3
    np.testing.assert_array_equal(play(environment, 1)[0], play(load(random=3), 1)[0])


@pytest.mark.full
@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"episode_seeds": "yes"}, TypeError, ["episode_seeds", "'yes'"]),
        ({"episode_seeds": 0}, ValueError, ["episode_seeds", "at least 1", "0"]),
        ({"episode_seeds": True, "random": np.random.RandomState(0)}, TypeError, ["episode_seeds", "RandomState"]),
        ({"episode_seeds": True, "random": -1}, ValueError, ["random", "-1"]),
    ],
)
def test_bad_arguments_are_refused(options, error, words):
    with refused(error, *words):
        load(**options)


def test_a_fixed_initial_state_is_refused():
    with refused(ValueError, "fixed_initial_state", "episode_seeds"):
        suite.load("kitchen", "kettle", {"episode_seeds": True}, {"fixed_initial_state": True})


@pytest.mark.full
def test_a_random_state_set_later_is_refused_and_nothing_changes():
    environment, other = load(episode_seeds=True), load(episode_seeds=True)
    with refused(TypeError, "episode_seeds", "RandomState"):
        environment.random_state = np.random.RandomState(0)
    np.testing.assert_array_equal(play(environment, 1)[0], play(other, 1)[0])


@pytest.mark.full
@pytest.mark.parametrize(
    ("spoil", "error"),
    [
        (lambda state: state.pop("next_seed"), ValueError),
        (lambda state: state.update(next_seed=-2), ValueError),
        (lambda state: state.update(next_seed=0.5), TypeError),
    ],
)
def test_states_without_a_seed_are_refused_and_nothing_changes(spoil, error):
    environment, other = load(episode_seeds=True), load(episode_seeds=True)
    state = load(episode_seeds=True, random=8).get_state()
    spoil(state)
    with refused(error, "next_seed"):
        environment.set_state(state)
    np.testing.assert_array_equal(play(environment, 1)[0], play(other, 1)[0])


@pytest.mark.full
def test_an_environment_of_one_stream_refuses_a_state_with_a_next_seed():
    with refused(ValueError, "next_seed"):
        load().set_state(load(episode_seeds=True).get_state())

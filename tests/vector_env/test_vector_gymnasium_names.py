"""Vectorised environments have the public attributes of Gymnasium's own vectors, or say where to find the same."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.errors import refused

from kitchen_suite.suite import DOMAINS

ENV_ID = DOMAINS["open_cabinet"].env_id
KITCHEN_ID = DOMAINS["kitchen"].env_id


def public_names(mode):
    own = gymnasium.make_vec("CartPole-v1", 1, vectorization_mode=mode)
    names = {name for name in dir(own) if not name.startswith("_")}
    own.close()
    return names


@pytest.fixture(scope="module")
def environments():
    made = gymnasium.make_vec(ENV_ID, 2, num_threads=1)
    made.reset(seed=0)
    yield made
    made.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_each_public_attribute_is_there_or_its_error_says_why_not(mode, environments):
    plain = "object has no attribute"  # Python's own words, which help nobody.
    unwrapped = environments.unwrapped
    for name in sorted(name for name in public_names(mode) if not hasattr(unwrapped, name)):
        with pytest.raises(AttributeError) as raised:
            getattr(unwrapped, name)
        assert name in str(raised.value)
        assert plain not in str(raised.value), name


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_attributes_are_those_of_gymnasiums_own_vector(domain):
    options = {"max_episode_steps": 7}
    ours = gymnasium.make_vec(DOMAINS[domain].env_id, 2, num_threads=1, **options)
    own = gymnasium.make_vec(DOMAINS[domain].env_id, 2, vectorization_mode="sync", **options)
    for environments in (ours, own):
        environments.reset(seed=3)
    for name in (
        *("action_space", "observation_space", "single_action_space", "single_observation_space", "num_envs"),
        *("autoreset_mode", "metadata", "render_mode", "copy", "observation_mode", "closed", "np_random_seed"),
    ):
        assert getattr(ours, name) == getattr(own, name), name
    read = ("render_mode", "max_episode_steps", "task", "instructions", "np_random_seed", "action_space")
    for name in read:
        assert ours.get_attr(name) == ours.call(name)
    for name in ("render_mode", "np_random_seed", "action_space", "observation_space"):
        assert ours.get_attr(name) == own.get_attr(name), name
    for found, expected in zip(ours.get_attr("metadata"), own.get_attr("metadata"), strict=True):
        # Gymnasium 1.2 writes the vector's mode to that of each environment.
        expected = {name: value for name, value in expected.items() if name != "autoreset_mode"}
        assert found == expected
    assert [each.max_episode_steps for each in ours.get_attr("spec")] == [7, 7]
    assert [generator.bit_generator.state for generator in ours.get_attr("np_random")] == [
        generator.bit_generator.state for generator in ours.np_random
    ]
    for environments in (ours, own):
        environments.close()


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_autoreset_mode_is_an_attribute_as_well(mode):
    environments = gymnasium.make_vec(ENV_ID, 1, num_threads=1, autoreset_mode=mode)
    assert environments.autoreset_mode == environments.metadata["autoreset_mode"] == mode
    environments.close()


@pytest.mark.full
def test_goal_methods_are_called_for_every_environment_as_by_gymnasiums_own():
    ours = gymnasium.make_vec(KITCHEN_ID, 2, num_threads=1, goal_format="flat")
    own = gymnasium.make_vec(KITCHEN_ID, 2, vectorization_mode="sync", goal_format="flat")
    space = ours.single_observation_space
    arguments = (space["achieved_goal"].sample(), space["desired_goal"].sample(), {"episode_step": 1})
    for name in ("compute_reward", "compute_terminated", "compute_truncated"):
        assert ours.call(name, *arguments) == own.call(name, *arguments)
    ours.close()
    own.close()


@pytest.mark.full
@pytest.mark.rendering
def test_render_is_called_as_gymnasiums_own():
    shown = gymnasium.make_vec(ENV_ID, 2, num_threads=1, render_mode="rgb_array", width=32, height=24)
    shown.reset(seed=0)
    images = shown.call("render")
    assert [image.shape for image in images] == [(24, 32, 3)] * 2
    np.testing.assert_array_equal(images, shown.render())
    shown.close()


@pytest.mark.filterwarnings("ignore:.*without a render_mode")
def test_without_a_render_mode_nothing_is_rendered(environments):
    assert environments.call("render") == (None, None)


@pytest.mark.parametrize("name", ["reset", "step", "get_state", "no_such"])
def test_methods_of_one_episode_are_refused(name, environments):
    with refused(AttributeError, name):
        environments.call(name)


def test_attributes_cannot_be_set_and_the_error_names_the_ways(environments):
    with refused(AttributeError, "drawer", "variations", "reset"):
        environments.set_attr("drawer", "bottom")
    # The ways: when they are built, and by options of a reset.
    other = gymnasium.make_vec(ENV_ID, 1, num_threads=1, drawer="bottom", variations=["dynamics"])
    other.reset(seed=0)
    name = next(iter(other.unwrapped.variation_space))
    other.reset(options={"variation": [name]})
    other.close()


def test_the_environment_that_the_error_on_single_ones_names_is_there(environments):
    with refused(AttributeError, "template_env", "get_attr"):
        _ = environments.envs
    assert environments.template_env.action_space == environments.single_action_space
    assert environments.get_attr("task") == (environments.template_env.task,) * 2

"""Arguments that only one way of building environments takes are refused elsewhere with the way to take there."""

import inspect

import dm_env
import gymnasium
import numpy as np
import pytest
from dm_control import mujoco
from dm_env import specs
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.domains.base import Domain
from kitchen_suite.suite import DOMAINS


def names_of(*functions):
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = [each for function in functions for each in inspect.signature(function).parameters.values()]
    return {each.name for each in parameters if each.kind in by_name} - {"self", "scene", "root"}


def constructors_of(cls):
    return [vars(base)["__init__"] for base in cls.__mro__ if "__init__" in vars(base)]


def of_gymnasium(domain):
    return names_of(*constructors_of(domain.resolve("env")), *domain.argument_functions)


def of_load(domain):
    return names_of(Domain.load, *domain.argument_functions)


def of_vectors(domain):
    return names_of(*constructors_of(domain.resolve("vector_env"))) | of_gymnasium(domain)


def load(domain, **task_kwargs):
    return suite.load(domain, suite.default_task(domain), {"visuals": False, **task_kwargs})


# The first words of an error that lists all arguments.
LIST = "choose from"


@pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS)
def test_what_suite_load_does_not_take_is_refused_with_the_way(domain):
    missing = (of_gymnasium(domain) | of_vectors(domain)) - of_load(domain)
    assert {"action_limit", "obs_type", "num_envs"} <= missing
    for name in sorted(missing):
        with refused(TypeError, f"unexpected argument {name!r}: ") as raised:
            suite.load(domain.name, suite.default_task(domain.name), {name: 1})
        assert LIST not in str(raised.value)


@pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS)
def test_what_gymnasium_does_not_take_is_refused_with_the_way(domain):
    single, many = of_gymnasium(domain), of_vectors(domain)
    environment_class, vector_class = domain.resolve("env"), domain.resolve("vector_env")
    assert {"time_limit", "random", "environment_kwargs"} <= of_load(domain) - many
    for name in sorted((of_load(domain) | many) - single):
        with refused(TypeError, f"unexpected keyword argument {name!r}: ") as raised:
            environment_class(**{name: 1})
        assert LIST not in str(raised.value)
    for name in sorted(of_load(domain) - many):
        with refused(TypeError, f"unexpected keyword argument {name!r}: "):
            vector_class(1, num_threads=1, **{name: 1})


def test_other_names_still_get_the_nearest_and_the_list():
    with refused(TypeError, "action_limits", LIST):
        load("open_cabinet", action_limits=1)
    with refused(TypeError, "time_limits", LIST):
        gymnasium.make(DOMAINS["kitchen"].env_id, time_limits=1)


# What the errors name, followed.


@pytest.mark.parametrize("domain", DOMAINS)
def test_the_control_mode_that_the_error_on_action_limit_names_has_bounds(domain):
    spec = load(domain, control_mode="joint_delta").action_spec()
    assert isinstance(spec, specs.BoundedArray)
    assert np.isfinite([spec.minimum, spec.maximum]).all()


@pytest.mark.parametrize("domain", DOMAINS)
def test_the_other_ways_of_dm_env_exist(domain):
    environment = load(domain, time_limit=0.5)
    assert environment.step_limit == np.ceil(0.5 / environment.control_timestep())
    assert isinstance(environment.task.instruction, str)
    flat = suite.load(domain, suite.default_task(domain), {"visuals": False}, {"flat_observation": True})
    (array,) = flat.reset().observation.values()
    assert array.ndim == 1
    if domain == "kitchen":
        assert [key for key in environment.reset().observation if key.startswith("achieved_goal/")]
        assert environment.task.step_task_completions == []


@pytest.mark.rendering
def test_images_are_rendered_by_physics_and_by_dm_controls_cameras():
    environment = suite.load("open_cabinet", "top_drawer")
    environment.reset()
    assert environment.physics.render(24, 32, camera_id="overview").shape == (24, 32, 3)
    camera = mujoco.MovableCamera(environment.physics, 24, 32, max_geom=500)
    camera.set_pose((0.4, 0.0, 0.5), 2.0, 125.0, -25.0)
    assert camera.render().shape == (24, 32, 3)


@pytest.mark.parametrize("domain", DOMAINS)
def test_the_ways_of_gymnasium_exist(domain):
    environment = gymnasium.make(DOMAINS[domain].env_id, obs_type="state", max_episode_steps=2)
    observation, _ = environment.reset(seed=0)
    assert observation.ndim == 1
    environment.step(environment.action_space.sample())
    *_, truncated, _ = environment.step(environment.action_space.sample())
    assert truncated
    environment.close()
    vectors = gymnasium.make_vec(
        DOMAINS[domain].env_id, 1, vectorization_mode="sync", vector_kwargs={"autoreset_mode": "SameStep"}
    )
    assert vectors.metadata["autoreset_mode"].value == "SameStep"
    vectors.close()
    many = gymnasium.make_vec(DOMAINS[domain].env_id, num_envs=2, num_threads=1, autoreset_mode="SameStep")
    assert many.num_envs == 2
    many.close()
    assert isinstance(load(domain).reset(), dm_env.TimeStep)

"""The open_cabinet domain's builder, its options, and its errors."""

import pickle

import dm_env
import numpy as np
import pytest
from dm_control.rl import control
from dm_control.suite.wrappers import action_noise, action_scale, pixels
from dm_env import specs
from helpers.errors import refused

from kitchen_suite import entities, suite

TASKS = ("top_drawer", "bottom_drawer")


def load(task="top_drawer", environment_kwargs=None, **options):
    return suite.load("open_cabinet", task, {"random": 0, "visuals": False, **options}, environment_kwargs)


def test_the_suite_knows_the_domain():
    assert suite.TASKS_BY_DOMAIN["open_cabinet"] == TASKS
    assert {("open_cabinet", task) for task in TASKS} <= set(suite.ALL_TASKS)


@pytest.mark.parametrize("task", TASKS)
def test_each_task_observes_its_own_drawer(task):
    env = load(task)
    env.reset()
    joint = env.physics.named.data.qpos
    joint[f"cabinet/{'_'.join(reversed(task.split('_')))}_joint"] = 0.2
    env.physics.forward()
    assert env.step(np.zeros(8)).observation["drawer_position"] == pytest.approx(0.2, abs=0.01)


def test_the_action_has_no_bounds():
    spec = load().action_spec()
    assert (spec.shape, spec.dtype) == ((8,), np.float64)
    assert type(spec) is specs.Array
    assert len(spec.name.split("\t")) == 8


def test_the_action_specs_generated_value_is_one_that_step_takes():
    env = load()
    env.reset()
    spec = env.action_spec()
    np.testing.assert_array_equal(spec.generate_value(), np.zeros(8))
    assert env.step(spec.generate_value()).mid()
    for twin in (pickle.loads(pickle.dumps(spec)), spec.replace(name="action")):
        np.testing.assert_array_equal(twin.generate_value(), np.zeros(8))


def test_dm_controls_action_wrappers_refuse_an_action_without_bounds():
    with pytest.raises(ValueError, match="must return a single `BoundedArray`"):
        action_scale.Wrapper(load(), minimum=-1.0, maximum=1.0)
    with refused(AttributeError, "'minimum'"):
        action_noise.Wrapper(load())


@pytest.mark.full
@pytest.mark.rendering
def test_dm_controls_pixels_wrapper_adds_a_picture():
    env = suite.load("open_cabinet", "top_drawer", {"random": 0})
    wrapped = pixels.Wrapper(env, pixels_only=False, render_kwargs={"height": 48, "width": 64, "camera_id": "handle"})
    assert wrapped.reset().observation["pixels"].shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("action", "error", "shown"),
    [
        (np.zeros(9), ValueError, ["action", "(8,)", "(9,)"]),
        (np.array([0.0] * 7 + [np.nan]), ValueError, ["action"]),
        (["close"] * 8, TypeError, ["action", "8"]),
    ],
)
def test_a_bad_action_is_refused_before_anything_changes(action, error, shown):
    env = load()
    env.reset()
    env.step(np.full(8, 0.01))
    before = (*env.random_state.get_state()[1:3], env.task.get_state()["previous_action"], env.physics.data.ctrl)
    copies = [np.copy(value) for value in before]
    with refused(error, *shown):
        env.step(action)
    after = (*env.random_state.get_state()[1:3], env.task.get_state()["previous_action"], env.physics.data.ctrl)
    for value, copy in zip(after, copies, strict=True):
        np.testing.assert_array_equal(value, copy)
    assert env.step(np.zeros(8)).mid()


@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"gripper": "sampeld"}, ValueError, ["'sampeld'", "'sampled'"]),
        ({"observation_noise": {"handle": 0.1}}, ValueError, ["'handle'"]),
        ({"observation_noise": {"handle_offset": -0.1}}, ValueError, ["observation_noise", "'handle_offset'"]),
        ({"observation_noise": 0.1}, TypeError, ["observation_noise"]),
        ({"variations": {"franka/pad_frction": 1}}, ValueError, ["'franka/pad_frction'", "'franka/pad_friction'"]),
        ({"cabinet_config": "large"}, TypeError, ["cabinet_config", "'large'"]),
        ({"colour": "red"}, TypeError, ["colour"]),
    ],
)
def test_bad_options_are_refused(options, error, shown):
    with refused(error, *shown):
        load(**options)


def test_an_unknown_drawer_is_refused_with_the_nearest_name():
    with refused(ValueError, "'top_draw'", "'top_drawer'"):
        load("top_draw")


def test_divergence_ends_the_episode_and_the_next_step_starts_a_clean_one():
    env = load()
    env.reset()
    env.physics.data.qvel[0] = 1e12
    with pytest.raises(control.PhysicsError):
        env.step(np.zeros(8))
    assert env.step(np.zeros(8)).first()
    assert env.step(np.zeros(8)).mid()


def test_divergence_may_end_the_episode_without_an_error():
    env = load(environment_kwargs={"raise_exception_on_physics_error": False})
    env.reset()
    env.physics.data.qvel[0] = 1e12
    timestep = env.step(np.zeros(8))
    assert (timestep.step_type, timestep.reward, timestep.discount) == (dm_env.StepType.LAST, 0.0, 0.0)
    assert env.step(np.zeros(8)).first()


def test_no_limit_means_no_limit():
    env = load(time_limit=None)
    env.reset()
    for _ in range(705):
        assert env.step(np.zeros(8)).mid()


def test_a_cabinet_config_reaches_the_scene():
    env = load(cabinet_config=entities.CabinetConfig(drawer_friction=5.0, drawer_damping=20.0))
    joint = env.physics.bind(env.task.scene.cabinet.drawer_joint("top"))
    assert (joint.frictionloss.item(), joint.damping.item()) == (5.0, 20.0)

"""The open_cabinet domain's builder, its options, and what it refuses."""

import dm_env
import numpy as np
import pytest
from dm_control.composer.variation import distributions
from dm_control.rl import control
from dm_control.suite.wrappers import action_noise, action_scale, pixels

from kitchen_suite import entities, suite
from kitchen_suite.tasks import Randomization
from kitchen_suite.tasks.drawer_randomization import MODERATE

TASKS = ("top_drawer", "bottom_drawer")


def load(task="top_drawer", environment_kwargs=None, **options):
    return suite.load("open_cabinet", task, {"random": 0, "visuals": False, **options}, environment_kwargs)


def test_the_suite_knows_the_domain():
    assert suite.TASKS_BY_DOMAIN["open_cabinet"] == TASKS
    assert {("open_cabinet", task) for task in TASKS} <= set(suite.ALL_TASKS)


@pytest.mark.parametrize("task", TASKS)
def test_each_task_is_about_its_own_drawer(task):
    env = load(task)
    env.reset()
    joint = env.physics.named.data.qpos
    joint[f"cabinet/{'_'.join(reversed(task.split('_')))}_joint"] = 0.2
    env.physics.forward()
    assert env.step(np.zeros(8)).observation["drawer_position"] == pytest.approx(0.2, abs=0.01)


def test_the_action_has_no_bounds():
    spec = load().action_spec()
    assert (spec.shape, spec.dtype) == ((8,), np.float64)
    assert np.isneginf(spec.minimum).all()
    assert np.isposinf(spec.maximum).all()
    assert len(spec.name.split("\t")) == 8


def test_dm_controls_action_wrappers_refuse_an_action_without_bounds():
    with pytest.raises(ValueError, match="must be finite"):
        action_scale.Wrapper(load(), minimum=-1.0, maximum=1.0)
    with pytest.raises(ValueError, match="must be finite"):
        action_noise.Wrapper(load())


@pytest.mark.rendering
def test_dm_controls_pixels_wrapper_adds_a_picture():
    env = suite.load("open_cabinet", "top_drawer", {"random": 0})
    wrapped = pixels.Wrapper(env, pixels_only=False, render_kwargs={"height": 48, "width": 64, "camera_id": "handle"})
    assert wrapped.reset().observation["pixels"].shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (np.zeros(9), ValueError, r"action must have shape \(8,\), got shape \(9,\)"),
        (np.zeros((1, 8)), ValueError, r"action must have shape \(8,\), got shape \(1, 8\)"),
        (np.array([0.0] * 7 + [np.nan]), ValueError, "action must be finite, got"),
        (np.array([np.inf] + [0.0] * 7), ValueError, "action must be finite, got"),
        (["close"] * 8, TypeError, "action must hold 8 numbers, got"),
    ],
)
def test_a_bad_action_is_refused_before_anything_changes(action, error, message):
    env = load()
    env.reset()
    env.step(np.full(8, 0.01))
    before = (*env.random_state.get_state()[1:3], env.task.get_state()["previous_action"], env.physics.data.ctrl)
    copies = [np.copy(value) for value in before]
    with pytest.raises(error, match=message):
        env.step(action)
    after = (*env.random_state.get_state()[1:3], env.task.get_state()["previous_action"], env.physics.data.ctrl)
    for value, copy in zip(after, copies, strict=True):
        np.testing.assert_array_equal(value, copy)
    assert env.step(np.zeros(8)).mid()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"gripper": "sampeld"}, ValueError, r"gripper 'sampeld' does not exist \(did you mean 'sampled'"),
        ({"observation_noise": {"handle": 0.1}}, ValueError, "part of the observation 'handle' does not exist"),
        ({"observation_noise": {"handle_offset": -0.1}}, ValueError, "observation_noise of 'handle_offset' must be"),
        ({"observation_noise": 0.1}, TypeError, "observation_noise must map parts"),
        ({"randomization": "yes"}, TypeError, "randomization must be a Randomization, got 'yes'"),
        ({"design": "large"}, TypeError, "design must be a CabinetDesign, got 'large'"),
        ({"visuals": 1}, TypeError, "visuals must be True or False, got 1"),
        ({"time_limit": 0}, ValueError, "time_limit must be finite and positive, got 0"),
        ({"time_limit": float("nan")}, ValueError, "time_limit must be finite and positive, got nan"),
        ({"random": -1}, ValueError, "random must not be negative, got -1"),
        ({"colour": "red"}, TypeError, "colour"),
    ],
)
def test_bad_options_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        load(**options)


def test_an_unknown_drawer_is_refused_with_the_nearest_name():
    with pytest.raises(ValueError, match=r"'top_draw' does not exist \(did you mean 'top_drawer'"):
        load("top_draw")


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"life_steps": -1}, ValueError),
        ({"life_steps": 1.5}, TypeError),
        ({"previous_action": np.zeros(7)}, ValueError),
        ({"previous_action": np.full(8, np.nan)}, ValueError),
        ({"colour": 1}, ValueError),
    ],
)
def test_a_bad_state_is_refused_before_anything_changes(change, error):
    task = load().task
    before = task.get_state()
    with pytest.raises(error, match=next(iter(change))):
        task.set_state({**before, "terminates": True, **change})
    assert task.get_state()["terminates"] is False


@pytest.mark.parametrize("randomization", [None, MODERATE])
def test_an_environment_goes_on_from_anothers_state(randomization):
    one, other = (load(random=seed, randomization=randomization) for seed in (1, 2))
    random = np.random.default_rng(0)
    actions = 0.05 * random.normal(size=(40, 8))
    for env in (one, other):
        env.reset()
    for action in actions[:20]:
        one.step(action)
    observation = other.set_state(one.get_state())
    now = one.task.get_state()["snapshot"]["handle_position"] - one.task.get_state()["snapshot"]["tcp_position"]
    np.testing.assert_allclose(observation["handle_offset"], now, atol=1e-6)
    assert other.task.reward_terms == one.task.reward_terms
    for action in actions[20:]:
        mine, copy = one.step(action), other.step(action)
        assert mine.reward == copy.reward
        for name, values in mine.observation.items():
            np.testing.assert_array_equal(values, copy.observation[name])


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


def test_a_design_reaches_the_scene():
    env = load(design=entities.CabinetDesign(drawer_friction=5.0, drawer_damping=20.0))
    joint = env.physics.bind(env.task.scene.cabinet.drawer_joint("top"))
    assert (joint.frictionloss.item(), joint.damping.item()) == (5.0, 20.0)


def scene_state(env):
    env.reset()
    cabinet, robot = env.task.scene.cabinet, env.task.scene.robot
    slide, pad = env.physics.bind(cabinet.drawer_joint("top")), env.physics.bind(robot.finger_geoms("right")[0])
    handle = env.physics.bind(cabinet.handle_site("top"))
    return np.concatenate([handle.xpos, handle.xmat[:3], slide.frictionloss, slide.damping, pad.friction[:1]])


def test_without_randomization_only_the_robots_pose_is_drawn():
    env = load()
    starts = {tuple(scene_state(env)) for _ in range(5)}
    assert len(starts) == 1


def test_randomization_draws_the_scene_anew():
    env = load(randomization=MODERATE)
    starts = np.array([scene_state(env) for _ in range(200)])
    spread = starts.max(axis=0) - starts.min(axis=0)
    np.testing.assert_allclose(spread[7:], [10.0, 0.6], rtol=0.05)
    np.testing.assert_allclose(spread[6], 1.5, rtol=0.05)
    # The handle moves with the cabinet: up to 3 cm and 5 cm, and 0.3 m times the yaw to the side.
    assert (spread[:2] > [0.05, 0.1]).all()
    np.testing.assert_allclose(starts[:, 2], 0.66, atol=1e-12)


def test_randomization_takes_constants_and_returns_to_the_built_place():
    env = load(
        randomization=Randomization(cabinet_offset=(0.01, 0.0, 0.0), drawer_friction=distributions.Uniform(2, 4))
    )
    for _ in range(3):
        state = scene_state(env)
        np.testing.assert_allclose(state[:3], [0.313, 0, 0.66], atol=1e-12)
        assert 2 <= state[6] <= 4
        assert state[7] == 15.0


def test_the_same_seed_draws_the_same_scenes():
    one, same = (load(randomization=MODERATE) for _ in range(2))
    for _ in range(3):
        np.testing.assert_array_equal(scene_state(one), scene_state(same))


def test_observations_follow_the_cabinet():
    env = load(randomization=MODERATE)
    for _ in range(20):
        observation = env.reset().observation
        data = env.physics.named.data
        offset = data.site_xpos["cabinet/drawer_top_handle"] - data.site_xpos["franka/gripper"]
        np.testing.assert_allclose(observation["handle_offset"], offset, atol=1e-6)

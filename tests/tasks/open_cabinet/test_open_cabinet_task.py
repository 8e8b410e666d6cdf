"""The open_cabinet task: observations, actions, rewards, termination, noise and random streams."""

import dataclasses

import mujoco
import numpy as np
import pytest
from helpers.open_cabinet import HIGH, LOW, ROBOT_JOINTS, TERMS, Recomputed, flat, load

from kitchen_suite import suite
from kitchen_suite.tasks import OpenCabinetTask
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE


def test_the_parts_of_the_observation():
    timestep = load().reset()
    sizes = {name: values.shape for name, values in timestep.observation.items()}
    assert list(sizes.items()) == [
        ("joint_positions", (8,)),
        ("joint_velocities", (8,)),
        ("handle_offset", (3,)),
        ("handle_orientation_offset", (4,)),
        ("drawer_position", (1,)),
        ("drawer_velocity", (1,)),
    ]
    assert all(values.dtype == np.float32 for values in timestep.observation.values())


def test_a_flat_observation_is_the_parts_end_to_end():
    options = {"random": 3, "visuals": False}
    parts = suite.load("open_cabinet", "top_drawer", options)
    whole = suite.load("open_cabinet", "top_drawer", options, environment_kwargs={"flat_observation": True})
    for action in (None, np.full(8, 0.01), np.zeros(8)):
        steps = [env.reset() if action is None else env.step(action) for env in (parts, whole)]
        np.testing.assert_array_equal(steps[1].observation["observations"], flat(steps[0]))
    spec = whole.observation_spec()["observations"]
    assert (spec.shape, spec.dtype) == ((25,), np.float32)


@pytest.mark.full
def test_how_an_episode_starts():
    env = load()
    starts = []
    for _ in range(300):
        env.reset()
        data = env.physics.data
        starts.append(data.qpos[:9].copy())
        np.testing.assert_array_equal(data.qpos[9:], 0)
        np.testing.assert_array_equal(data.qvel, 0)
        np.testing.assert_array_equal(data.ctrl, starts[-1])
        assert env.task.reward_terms == dict.fromkeys(TERMS, 0.0)
        np.testing.assert_array_equal(env.task.get_state()["previous_action"], 0)
    noise = np.array(starts) - DEFAULT_POSE
    assert (abs(noise) <= 0.125).all()
    # The extremes of 300 draws from U(-0.125, 0.125).
    assert (noise[:, :7].max(axis=0) > 0.12).all()
    assert (noise[:, :7].min(axis=0) < -0.12).all()
    # Fingers are clipped: half of them start fully open.
    fingers = np.array(starts)[:, 7:]
    assert ((fingers >= 0) & (fingers <= 0.04)).all()
    assert 0.4 < (fingers == 0.04).mean() < 0.6


def test_an_episode_lasts_seven_seconds():
    env = load()
    timestep, steps = env.reset(), 0
    while not timestep.last():
        timestep, steps = env.step(np.zeros(8)), steps + 1
    assert (steps, timestep.discount) == (700, 1.0)
    assert env.control_timestep() == 0.01
    assert env.physics.timestep() == 0.005


def test_an_action_is_an_offset_from_where_the_joints_are():
    env = load(gripper="deterministic")
    env.reset()
    for action in (np.linspace(-0.1, 0.1, 8), np.full(8, 1e6), np.full(8, -1e6)):
        before = env.physics.data.qpos[:7].copy()
        env.task.before_step(env.physics, action, env.random_state)
        np.testing.assert_array_equal(env.physics.data.ctrl[:7], np.clip(before + action[:7], LOW[:7], HIGH[:7]))
        np.testing.assert_array_equal(env.physics.data.ctrl[7:], 0.0 if action[7] > 0 else 0.04)


@pytest.mark.full
@pytest.mark.parametrize("action", [-2.0, 0.0, 0.7, 3.0])
def test_the_gripper_closes_with_the_probability_of_its_logit(action):
    env = load()
    env.reset()
    closed, draws = 0, 20_000
    for _ in range(draws):
        env.task.before_step(env.physics, np.append(np.zeros(7), action), env.random_state)
        left, right = env.physics.data.ctrl[7:]
        assert left == right
        assert left in (0.0, 0.04)
        closed += left == 0.0
    probability = 1 / (1 + np.exp(-action))
    assert abs(closed / draws - probability) < 5 * np.sqrt(probability * (1 - probability) / draws)


def episode(env, steps=60, seed=5):
    random = np.random.default_rng(seed)
    timesteps = [env.reset(), *(env.step(0.05 * random.normal(size=8)) for _ in range(steps))]
    return np.array([flat(timestep) for timestep in timesteps]), [timestep.reward for timestep in timesteps]


@pytest.mark.full
def test_the_same_seed_gives_the_same_episodes():
    one, same, other = load(random=7), load(random=7), load(random=8)
    for _ in range(2):
        mine, equal, different = episode(one), episode(same), episode(other)
        np.testing.assert_array_equal(mine[0], equal[0])
        assert mine[1] == equal[1]
        assert abs(mine[0] - different[0]).max() > 0.01


@pytest.mark.full
def test_the_gripper_draws_from_the_environments_random_state():
    env = load()
    env.reset()
    assert env.task.random is env.random_state
    expected = np.random.RandomState()
    expected.set_state(env.random_state.get_state())
    for _ in range(20):
        env.step(np.zeros(8))
        assert env.physics.data.ctrl[8] == (0.0 if expected.uniform() < 0.5 else 0.04)


def test_a_deterministic_gripper_draws_nothing():
    env = load(gripper="deterministic")
    env.reset()
    before = env.random_state.get_state()[1:3]
    for _ in range(5):
        env.step(np.append(np.zeros(7), 1.0))
        np.testing.assert_array_equal(env.physics.data.ctrl[7:], 0.0)
    after = env.random_state.get_state()[1:3]
    np.testing.assert_array_equal(before[0], after[0])
    assert before[1] == after[1]


@pytest.mark.full
def test_penalties_grow_after_8000_total_steps_and_resets_do_not_restart_the_count():
    env = load()
    action, efforts = np.full(8, 0.02), []
    env.reset()
    # An episode has 700 steps: one ends before the penalties grow.
    env.task.total_steps = 7_000
    while env.task.total_steps < 8_004:
        # The action alternates, so that its change is the same in every step but an episode's first.
        action = -action
        timestep = env.step(action)
        if timestep.first():
            continue
        velocity = env.physics.data.qvel[:8]
        efforts.append((env.task.reward_terms["effort"], (velocity**2).sum(), env.task.total_steps))
    by_step = {step: (effort, squares) for effort, squares, step in efforts}
    assert len(by_step) == 1_004
    change = 8 * 0.04**2
    for step in (7_999, 8_000):
        np.testing.assert_allclose(by_step[step][0], -1e-3 * change, rtol=1e-12)
    for step in (8_001, 8_004):
        np.testing.assert_allclose(by_step[step][0], -2e-3 * change - 2e-7 * by_step[step][1], rtol=1e-12)


def test_reaching_through_the_handle_ends_the_episode():
    env = load()
    env.reset()
    with env.physics.reset_context():
        # 4 cm further in than the handle, above it.
        env.physics.named.data.qpos[ROBOT_JOINTS] = [0, 0.25, 0, -1.5, 0, 3.3, -0.785, 0, 0]
    tcp, handle = (
        env.physics.named.data.site_xpos[name][0] for name in ("franka/gripper", "cabinet/drawer_top_handle")
    )
    assert tcp < handle - 0.03
    timestep = env.step(np.zeros(8))
    assert timestep.last()
    assert timestep.discount == 0.0
    assert env.task.reward_terms["termination"] == -10.0
    assert env.step(np.zeros(8)).first()


@pytest.mark.full
@pytest.mark.parametrize("joint", range(9))
def test_a_joint_that_moves_too_fast_ends_the_episode(joint):
    env = load()
    env.reset()
    env.physics.named.data.qpos[["franka/finger_joint1", "franka/finger_joint2"]] = 0.02
    env.physics.data.qvel[joint] = 40.0
    env.physics.forward()
    timestep = env.step(np.zeros(8))
    assert abs(env.physics.data.qvel[joint]) > 5
    assert timestep.last()
    assert timestep.discount == 0.0


def test_success_ends_nothing():
    env = load()
    env.reset()
    with env.physics.reset_context():
        env.physics.named.data.qpos["cabinet/drawer_top_joint"] = 0.31
        # The hand is drawn back with the handle.
        env.physics.named.data.qpos[ROBOT_JOINTS] = [0, -1.03, 0, -2.8, 0, 3.34, -0.785, 0.04, 0.04]
    timestep = env.step(np.append(np.zeros(7), -50.0))
    assert env.task.is_success
    assert timestep.mid()
    assert env.task.drawer_opening == pytest.approx(0.31, abs=1e-6)
    env.physics.named.data.qpos["cabinet/drawer_top_joint"] = 0.25
    env.step(np.append(np.zeros(7), -50.0))
    metrics = env.task.episode_metrics
    assert (metrics["success"], metrics["success_at_any_time"]) == (False, True)
    assert metrics["drawer_opening"] == env.task.drawer_opening < 0.3
    env.reset()
    assert not env.task.episode_metrics["success_at_any_time"]


def test_a_run_starts_without_the_steps_of_earlier_ones():
    env = load()
    env.reset()
    env.step(np.zeros(8))
    assert env.task.total_steps == 1
    env.task.reset_statistics()
    assert env.task.total_steps == 0


@pytest.mark.full
def test_noise_is_off_unless_asked_for_and_is_then_clipped_too():
    clean, noisy = load(), load(observation_noise={"handle_offset": 0.02, "drawer_velocity": 10.0})
    assert all(part.corruptor is None for part in clean.task.observables.values() if part.enabled)
    clean.reset()
    errors = []
    for _ in range(400):
        observation = noisy.reset().observation
        true = Recomputed(noisy.physics, "top", np.zeros(8), 0).observation
        errors.append(np.concatenate(list(observation.values())) - true)
    errors = np.array(errors)
    assert abs(errors[:, :16]).max() < 1e-6
    assert 0.019 < abs(errors[:, 16:19]).max() <= 0.02 + 1e-6
    # Velocity is 0 at rest; noise of up to 10 is cut at 5.
    assert abs(errors[:, 24]).max() == 5
    assert 0.4 < (abs(errors[:, 24]) == 5).mean() < 0.6


def test_noise_is_one_draw_of_25_different_numbers_a_step():
    env = load(gripper="deterministic", observation_noise={"handle_offset": 0.02, "joint_positions": 0.5})
    env.reset()
    expected = np.random.RandomState()
    expected.set_state(env.random_state.get_state())
    scale = np.r_[np.full(8, 0.5), np.zeros(8), np.full(3, 0.02), np.zeros(6)]
    for _ in range(3):
        env.step(np.zeros(8))
        noise = env.task.get_state()["noise"]
        np.testing.assert_array_equal(noise, scale * expected.uniform(-1.0, 1.0, 25))
        assert len(set((noise[scale > 0] / scale[scale > 0]).round(9))) == 11
    assert env.random_state.uniform() == expected.uniform()


@pytest.mark.parametrize("legacy_step", [True, False])
def test_positions_in_the_world_are_those_after_the_step(legacy_step):
    options = {"random": 0, "visuals": False}
    env = suite.load("open_cabinet", "top_drawer", options, {"legacy_step": legacy_step})
    env.reset()
    for _ in range(5):
        timestep = env.step(np.full(8, 0.05))
        terms = env.task.reward_terms
        mujoco.mj_kinematics(env.physics.model.ptr, env.physics.data.ptr)
        expected = Recomputed(env.physics, "top", np.zeros(8), 0)
        np.testing.assert_allclose(flat(timestep), expected.observation, rtol=0, atol=1e-6)
        for name in ("approach", "orientation", "straddling"):
            assert abs(terms[name] - expected.terms[name]) < 1e-9


def test_any_corruptor_of_composers_can_be_set():
    env = load()
    env.task.observables["drawer_position"].corruptor = lambda value, random_state: value + 1
    observation = env.reset().observation["drawer_position"]
    assert observation == 1.0
    assert observation.dtype == np.float32


def test_the_reward_sees_no_noise():
    quiet, noisy = load(gripper="deterministic"), load(gripper="deterministic", observation_noise={"handle_offset": 1})
    for env in (quiet, noisy):
        env.reset()
    mujoco.mj_copyData(noisy.physics.data.ptr, quiet.physics.model.ptr, quiet.physics.data.ptr)
    assert quiet.step(np.zeros(8)).reward == noisy.step(np.zeros(8)).reward


def test_visualising_the_reward_colours_the_handle_of_an_open_drawer():
    env = suite.load("open_cabinet", "top_drawer", {"random": 0}, visualize_reward=True)
    env.reset()
    bar = env.physics.bind(env.task.scene.cabinet.mjcf_model.find("geom", "drawer_top_handle_bar_visual"))
    plain = np.array(bar.rgba)
    env.physics.named.data.qpos["cabinet/drawer_top_joint"] = 0.35
    env.step(np.zeros(8))
    np.testing.assert_allclose(bar.rgba, [0.25, 0.75, 0.3, 1.0], rtol=1e-6)
    env.reset()
    np.testing.assert_array_equal(bar.rgba, plain)


@pytest.mark.full
def test_a_term_of_ones_own_reads_the_states_before_and_after_the_step():
    def pull(step):
        return step.after.features[..., 34] - step.before.features[..., 34]

    task = type("OwnTask", (OpenCabinetTask,), {"extra_rewards": {"pull": pull}})
    domain = dataclasses.replace(suite.DOMAINS["open_cabinet"], name="own", task=task)
    environment = domain.load(random=0, visuals=False)
    environment.reset()
    before = environment.task.drawer_opening
    environment.step(np.zeros(8))
    assert environment.task.reward_terms["pull"] == environment.task.drawer_opening - before

"""Whole episodes and single steps against the original, run live: the difference is 0."""

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.original import original_environment, random_actions, reference_model
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene

STEPS = 280
OBSERVATION_KEYS = ("franka/joint_positions", "franka/joint_velocities", "object_positions", "object_velocities")
# Wider ones than the usual let random actions complete tasks at all sorts of times.
THRESHOLDS = (0.3, 0.36, 0.74)
QUIET = {"object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}


def load(random=0, task_name="all", **options):
    task_kwargs = {"random": random, "visuals": False, **options}
    return suite.load("kitchen", task_name, task_kwargs=task_kwargs)


def observation(timestep):
    return np.concatenate([timestep.observation[key] for key in OBSERVATION_KEYS])


# Of 20 seeds, 3 in every run: each threshold, with and without removal, with and without visuals.
@pytest.mark.parametrize("seed", brief(range(20), kept=[0], full=[1, 2]))
def test_whole_episodes_are_equal_without_noise(seed):
    remove = seed % 2 == 0
    threshold = THRESHOLDS[seed % 3]
    options = {**QUIET, "terminate_on_tasks_completed": False, "remove_task_when_completed": remove}
    ours = load(threshold=threshold, visuals=seed % 4 < 2, **options)
    timestep = ours.reset()
    with original_environment(threshold, **options) as original:
        seen, _ = original.reset(seed=seed)
        np.testing.assert_array_equal(observation(timestep), seen["observation"])
        for action in random_actions(np.random.default_rng(seed), STEPS):
            timestep = ours.step(action)
            seen, reward, terminated, _, info = original.step(action)
            np.testing.assert_array_equal(ours.physics.data.qpos, original.data.qpos)
            np.testing.assert_array_equal(ours.physics.data.qvel, original.data.qvel)
            np.testing.assert_array_equal(observation(timestep), seen["observation"])
            assert timestep.reward == reward
            assert not terminated
            assert set(ours.task.tasks_to_complete) == set(info["tasks_to_complete"])
            assert set(ours.task.step_task_completions) == set(info["step_task_completions"])
            assert set(ours.task.episode_task_completions) == set(info["episode_task_completions"])
            for task, goal in seen["desired_goal"].items():
                np.testing.assert_array_equal(timestep.observation[f"desired_goal/{task}"], goal)
                np.testing.assert_array_equal(
                    timestep.observation[f"achieved_goal/{task}"], seen["achieved_goal"][task]
                )
    assert timestep.last()
    assert timestep.discount == 1.0


@pytest.mark.full
def test_the_episodes_compared_complete_tasks_at_different_times():
    completed = set()
    for seed in (1, 2, 3):
        ours = load(threshold=THRESHOLDS[seed % 3], terminate_on_tasks_completed=False, **QUIET)
        ours.reset()
        for action in random_actions(np.random.default_rng(seed), STEPS):
            ours.step(action)
        completed |= set(ours.task.completion_steps.items())
    assert len({step for _, step in completed}) >= 3
    assert len({task for task, _ in completed}) >= 2


@pytest.mark.parametrize("seed", brief([0, 7, 2**40 + 3], kept=[2**40 + 3], full=[7]))
def test_noisy_observations_are_the_originals_for_the_same_seed(seed):
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))
    ours = load(np.random.RandomState(generator.bit_generator), terminate_on_tasks_completed=False)
    timestep = ours.reset()
    with original_environment(terminate_on_tasks_completed=False) as original:
        seen, _ = original.reset(seed=seed)
        np.testing.assert_array_equal(observation(timestep), seen["observation"])
        for step, action in enumerate(random_actions(np.random.default_rng(5), STEPS), start=1):
            timestep = ours.step(action)
            np.testing.assert_array_equal(observation(timestep), original.step(action)[0]["observation"])
            assert timestep.last() == (step == STEPS)
        # The stream goes on through the next reset.
        np.testing.assert_array_equal(observation(ours.step(None)), original.reset()[0]["observation"])


def test_float32_actions_are_used_as_they_are():
    ours = load(np.random.RandomState(np.random.PCG64(np.random.SeedSequence(1))))
    ours.reset()
    with original_environment() as original:
        original.reset(seed=1)
        for action in random_actions(np.random.default_rng(2), 40).astype(np.float32):
            np.testing.assert_array_equal(observation(ours.step(action)), original.step(action)[0]["observation"])


@pytest.mark.full
def test_one_step_from_a_thousand_states_is_equal():
    reference = reference_model()
    ours = mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=False).arena.mjcf_model).model.ptr
    here, there = mujoco.MjData(ours), mujoco.MjData(reference)
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS | mujoco.mjtState.mjSTATE_WARMSTART | mujoco.mjtState.mjSTATE_CTRL
    state = np.empty(mujoco.mj_stateSize(reference, spec))
    compared = touching = 0
    for seed in range(10):
        for there_now in visited_states(reference, seed, 100):
            mujoco.mj_getState(reference, there_now, state, spec)
            mujoco.mj_setState(ours, here, state, spec)
            mujoco.mj_setState(reference, there, state, spec)
            mujoco.mj_step(ours, here)
            mujoco.mj_step(reference, there)
            for field in ("qpos", "qvel", "qacc", "qacc_warmstart"):
                np.testing.assert_array_equal(getattr(here, field), getattr(there, field))
            compared += 1
            touching += robot_touches(reference, there)
    assert compared == 1_000
    assert touching > 100


@pytest.mark.full
@pytest.mark.parametrize("visuals", [True, False])
def test_rollouts_from_flung_states_are_equal(visuals):
    """All joints start anywhere, at great speed, and the kettle flies at the robot."""
    rng = np.random.default_rng(0)
    reference = reference_model()
    ours = mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=visuals).arena.mjcf_model).model.ptr
    touching = 0
    for _ in range(20):
        here, there = mujoco.MjData(ours), mujoco.MjData(reference)
        here.qpos[:], here.qvel[:] = there.qpos[:], there.qvel[:] = flung_state(rng, reference)
        for target in rng.uniform(*reference.actuator_ctrlrange.T, (60, reference.nu)):
            here.ctrl[:] = there.ctrl[:] = target
            mujoco.mj_step(ours, here, 20)
            mujoco.mj_step(reference, there, 20)
            np.testing.assert_array_equal(here.qpos, there.qpos)
            np.testing.assert_array_equal(here.qvel, there.qvel)
            touching += robot_touches(reference, there)
    assert touching > 30


def flung_state(rng, model):
    data = mujoco.MjData(model)
    low, high = model.jnt_range[:-1].T
    data.qpos[:23] = rng.uniform(low, high)
    mujoco.mj_kinematics(model, data)
    target = data.xpos[rng.integers(model.body("panda0_link3").id, model.body("panda0_rightfinger").id)]
    away = rng.normal(size=3)
    data.qpos[23:26] = target + 0.6 * away / np.linalg.norm(away)
    data.qpos[26:] = rng.normal(size=4)
    qvel = rng.normal(scale=3.0, size=model.nv)
    # [m/s]
    qvel[23:26] = 5.0 * (target - data.qpos[23:26])
    return data.qpos.copy(), qvel


def visited_states(model, seed, count):
    """States along a rollout that moves the robot about, with the kettle thrown at it."""
    rng = np.random.default_rng(seed)
    with original_environment(robot_noise_ratio=0.0) as original:
        original.reset(seed=seed)
        initial = original.data.qpos.copy()
    data = mujoco.MjData(model)
    data.qpos[:] = initial
    data.qpos[23:26] = rng.uniform((-0.3, 0.25, 1.85), (-0.2, 0.4, 2.0))
    target = initial[:9].copy()
    for step in range(count):
        if step % 10 == 0:
            target = data.qpos[:9] + rng.uniform(-1.5, 1.5, 9)
        data.ctrl[:] = target
        mujoco.mj_step(model, data, 20)
        yield data


def robot_touches(model, data):
    """Whether the robot touches anything but itself and the floor."""
    robot = set(range(model.body("panda0_link1").id, model.body("panda0_rightfinger").id + 1))
    bodies = [tuple(model.geom_bodyid[g] for g in contact.geom) for contact in data.contact]
    return any((a in robot) != (b in robot) for a, b in bodies)

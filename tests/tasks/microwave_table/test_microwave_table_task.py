"""The microwave_table domain: task, reward, success; single equal to vectorised; and every way in."""

import contextlib
import json

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from kitchen_suite import suite
from kitchen_suite.commands import record, replay, rollout
from kitchen_suite.tasks.microwave_table.mdp import SLICES

ENV_ID = "KitchenSuite/FrankaMicrowaveTable-v1"
DOMAIN = ["--domain_name=microwave_table", "--max_episode_steps=5"]


@pytest.fixture
def environment():
    environment = suite.load("microwave_table", "open", {"random": 0, "visuals": False})
    environment.reset()
    return environment


def set_door(environment, angle):
    """Moves the door, and makes a control step."""
    physics, task = environment.physics, environment.task
    physics.bind(task.scene.joints("microwave")).qpos = angle
    return environment.step(np.zeros(8))


def test_the_observation_is_that_of_the_physics(environment):
    timestep = environment.step(np.full(8, 0.05))
    physics, scene = environment.physics, environment.task.scene
    robot, door = physics.bind(scene.robot.joints), physics.bind(scene.joints("microwave"))
    handle = physics.bind(scene.props["microwave"].mjcf_model.find("site", "handle")).xpos
    tcp = physics.bind(scene.robot.end_effector).xpos
    expected = {
        "joint_positions": robot.qpos,
        "joint_velocities": robot.qvel,
        "handle_offset": handle - tcp,
        "door_position": door.qpos,
        "door_velocity": door.qvel,
    }
    assert list(timestep.observation) == list(expected) == list(SLICES)
    for name, value in expected.items():
        np.testing.assert_allclose(timestep.observation[name], value, atol=2e-6)


def test_a_control_step_is_two_steps_of_the_physics(environment):
    assert environment.control_timestep() == pytest.approx(0.01)
    assert environment.physics.timestep() == pytest.approx(0.005)


def test_an_open_door_is_a_success(environment):
    assert set_door(environment, -0.44).reward < 5.0
    assert not environment.task.episode_metrics["success"]
    timestep = set_door(environment, -0.75)
    metrics = environment.task.episode_metrics
    assert (metrics["success"], metrics["success_at_any_time"]) == (True, True)
    assert metrics["door_opening"] == pytest.approx(1.0, abs=0.01)
    assert timestep.mid()
    assert timestep.reward > 4.9
    set_door(environment, 0.0)
    metrics = environment.task.episode_metrics
    assert (metrics["success"], metrics["success_at_any_time"]) == (False, True)


def single_episodes(seed, actions, limit):
    """Yields observation, reward, truncation and infos of a single environment in autoreset mode NextStep."""
    env = gymnasium.make(ENV_ID, max_episode_steps=limit, gripper="sampled")
    observation, info = env.reset(seed=seed)
    yield observation, 0.0, False, info
    truncated = False
    for action in actions:
        if truncated:
            observation, info = env.reset()
            reward, truncated = 0.0, False
        else:
            observation, reward, _, truncated, info = env.step(action)
        yield observation, reward, truncated, info


@pytest.mark.full
@pytest.mark.parametrize("num_threads", [1, 2])
def test_vectorised_environments_equal_single_ones(num_threads):
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (17, 3, 8)).astype(np.float32)
    with contextlib.closing(
        gymnasium.make_vec(ENV_ID, 3, num_threads=num_threads, max_episode_steps=7, gripper="sampled")
    ) as environments:
        observations, infos = environments.reset(seed=5)
        rows = [(observations, np.zeros(3), np.zeros(3, bool), infos)]
        for action in actions:
            observations, rewards, _, truncations, infos = environments.step(action)
            rows.append((observations, rewards, truncations, infos))
    for i in range(3):
        expected = single_episodes(5 + i, actions[:, i], 7)
        for (observations, rewards, truncations, infos), (one, reward, truncated, info) in zip(
            rows, expected, strict=True
        ):
            np.testing.assert_array_equal(observations[i], one)
            assert (rewards[i], truncations[i]) == (reward, truncated)
            for key, value in info.items():
                assert infos[key][i] == value, key


def test_same_step_and_masked_resets_equal_next_step():
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 2, 8))

    def run(mode):
        arguments = {"num_threads": 1, "max_episode_steps": 3, "autoreset_mode": mode}
        with contextlib.closing(gymnasium.make_vec(ENV_ID, 2, **arguments)) as environments:
            environments.reset(seed=1)
            for action in actions[:3]:
                observations, _, _, truncations, infos = environments.step(action)
            assert truncations.all()
            if mode == AutoresetMode.SAME_STEP:
                return np.stack(infos["final_obs"]), observations
            if mode == AutoresetMode.NEXT_STEP:
                return observations, environments.step(actions[3])[0]
            mask = np.array([True, False])
            first = environments.reset(options={"reset_mask": mask})[0]
            second = environments.reset(options={"reset_mask": ~mask})[0]
            return observations, np.stack([first[0], second[1]])

    results = [run(mode) for mode in AutoresetMode]
    for last, start in results[1:]:
        np.testing.assert_array_equal(last, results[0][0])
        np.testing.assert_array_equal(start, results[0][1])


@pytest.mark.full
def test_a_state_continues_to_the_bit():
    one, other = gymnasium.make(ENV_ID), gymnasium.make(ENV_ID)
    one.reset(seed=3)
    other.reset(seed=4)
    one.step(np.full(8, 0.5))
    state = one.unwrapped.get_state()
    other.unwrapped.set_state(state)
    for action in np.random.default_rng(0).uniform(-1, 1, (3, 8)):
        for first, second in zip(one.step(action), other.step(action), strict=True):
            if isinstance(first, dict):
                assert first == second
            else:
                np.testing.assert_array_equal(first, second)


@pytest.mark.full
def test_the_commands_play_record_and_replay_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert rollout.main([*DOMAIN, "--num_episodes=1", "--output=rolled"]) == 0
    assert "microwave_table open, policy random" in capsys.readouterr().out
    assert record.main([*DOMAIN, "--num_episodes=3", "--output=runs", "--num_threads=1"]) == 0
    capsys.readouterr()
    for folder in ("rolled", "runs"):
        assert replay.main([folder]) == 0
        assert "episodes are equal" in capsys.readouterr().out
    assert json.loads((tmp_path / "runs" / "recording.json").read_text())["task_name"] == "open"

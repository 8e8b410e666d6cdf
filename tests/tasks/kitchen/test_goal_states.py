"""Goal states of the kitchen: what is observed of them, and the options of a reset that give them and the start."""

import copy
import pickle

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks.kitchen.goals import GOALS, INITIAL_QPOS
from kitchen_suite.vector_env import FrankaKitchenVectorEnv

STATE = np.r_[0:9, 18:39]
NO_NOISE = {"object_noise_ratio": 0.0, "robot_noise_ratio": 0.0}


def wanted(count=2):
    """Goal states with the microwave open by different angles."""
    goals = np.tile(INITIAL_QPOS, (count, 1))
    goals[:, 22] = np.linspace(-0.6, -0.3, count)
    return goals


@pytest.mark.full
@pytest.mark.parametrize("obs_type", ["goal", "state", "environment_state_agent_pos"])
def test_goal_states_are_observed_before_requests(obs_type):
    env = FrankaKitchenEnv(tasks_per_episode=2, goal_states=2, obs_type=obs_type)
    observation, _ = env.reset(seed=0, options={"goal_states": wanted()})
    for _ in range(2):
        assert env.observation_space.contains(observation)
        found = observation[59:119] if obs_type == "state" else observation["goal_states"]
        np.testing.assert_array_equal(found, wanted().ravel())
        observation, *_ = env.step(np.zeros(9))
    assert obs_type == "state" or [*observation][-2:] == ["goal_states", "requested_tasks"]
    assert [*env.present_observation][-2:] == ["goal_states", "requested_tasks"]
    inputs = env.environment.task.policy_inputs
    assert inputs.flatten(env.present_observation).size == inputs.size == 59 + 2 * 17 + 60 + 7
    np.testing.assert_array_equal(inputs.flatten(env.present_observation)[-67:-7], wanted().ravel())


def test_the_suites_own_environment_observes_them():
    environment = suite.load("kitchen", "all", task_kwargs={"goal_states": 1, "random": 0})
    environment.task.follow(environment.task.checked_reset({"goal_states": wanted(1)}))
    np.testing.assert_array_equal(environment.reset().observation["goal_states"], wanted(1)[0])
    assert [*environment.observation_spec()][-1] == "goal_states"
    assert environment.observation_spec()["goal_states"].shape == (30,)


@pytest.mark.parametrize("task", brief(GOALS, ["kettle", "close microwave", "top burner"]))
def test_the_goal_state_of_a_task_has_it_done(task):
    env = FrankaKitchenEnv([task], goal_states=1, **NO_NOISE)
    observation, _ = env.reset(seed=0)
    goal = observation["goal_states"]
    np.testing.assert_array_equal(goal[:9], INITIAL_QPOS[:9])
    env.reset(options={"start_state": goal})
    np.testing.assert_array_equal(env.environment.task.state.achieved, env.environment.task.mdp.goals.desired)
    assert (goal != INITIAL_QPOS).sum() <= len(GOALS[task].value)


@pytest.mark.full
def test_the_goal_state_has_what_is_requested_done():
    env = FrankaKitchenEnv(tasks_per_episode=1, goal_states=3)
    observation, _ = env.reset(seed=0, options={"requested_tasks": ["microwave"]})
    frames = observation["goal_states"].reshape(3, 30)
    np.testing.assert_array_equal(frames, np.tile(frames[0], (3, 1)))
    assert (frames[0] != INITIAL_QPOS).nonzero()[0].tolist() == [22]


def test_an_episode_starts_in_a_state_at_rest():
    env, generator = FrankaKitchenEnv(**NO_NOISE), np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(20):
        observation, *_ = env.step(generator.uniform(-1, 1, 9))
    start = observation["observation"][STATE]
    assert np.abs(start - INITIAL_QPOS).max() > 0.1
    again, info = env.reset(seed=1, options={"start_state": start})
    np.testing.assert_array_equal(again["observation"][STATE], start)
    np.testing.assert_array_equal(np.delete(again["observation"], STATE), 0.0)
    assert info["episode_task_completions"] == []
    # The next episode starts as usual.
    usual, _ = env.reset(seed=1)
    np.testing.assert_array_equal(usual["observation"][STATE], INITIAL_QPOS)


@pytest.mark.full
def test_requests_leave_the_random_stream_as_it_is():
    env = FrankaKitchenEnv(goal_states=1)
    plain, _ = env.reset(seed=3)
    asked, _ = env.reset(seed=3, options={"goal_states": wanted(1), "start_state": INITIAL_QPOS})
    np.testing.assert_array_equal(plain["observation"], asked["observation"])
    without, _ = FrankaKitchenEnv().reset(seed=3)
    np.testing.assert_array_equal(plain["observation"], without["observation"])


@pytest.mark.full
def test_states_and_copies_keep_them():
    env = FrankaKitchenEnv(tasks_per_episode=2, goal_states=2)
    env.reset(seed=0, options={"goal_states": wanted()})
    state, others = env.get_state(), [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    env.reset(seed=1)
    for each in (env, *others):
        np.testing.assert_array_equal(each.set_state(state)["goal_states"], wanted().ravel())
    with refused(ValueError, "goal_states"):
        FrankaKitchenEnv(tasks_per_episode=2, goal_states=1).set_state(state)


@pytest.mark.full
@pytest.mark.parametrize(
    "mode", [AutoresetMode.SAME_STEP, pytest.param(AutoresetMode.DISABLED, marks=pytest.mark.full)]
)
def test_vectorised_kitchens_have_their_own(mode):
    arguments = {"tasks_per_episode": (1, 3), "goal_states": 2}
    envs = FrankaKitchenVectorEnv(3, num_threads=1, autoreset_mode=mode, **arguments)
    starts = [None, INITIAL_QPOS + np.eye(30)[22] * -0.4, None]
    options = {"goal_states": [wanted(), None, None], "start_state": starts}
    observations, _ = envs.reset(seed=5, options=options)
    assert envs.observation_space.contains(observations)
    for i in range(3):
        single = FrankaKitchenEnv(**arguments)
        expected, _ = single.reset(seed=5 + i, options={name: rows[i] for name, rows in options.items()})
        for key in ("observation", "goal_states", "requested_tasks"):
            np.testing.assert_array_equal(observations[key][i], expected[key])
        np.testing.assert_array_equal(envs.present_numbers["goal_states"][i], expected["goal_states"])
    stepped, *_ = envs.step(np.zeros((3, 9)))
    np.testing.assert_array_equal(stepped["goal_states"], observations["goal_states"])
    again, _ = envs.reset(options={"reset_mask": np.array([True, False, False])})
    assert (again["goal_states"][0] != observations["goal_states"][0]).any()
    np.testing.assert_array_equal(again["goal_states"][1:], observations["goal_states"][1:])


@pytest.mark.full
@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"goal_states": wanted(3)}, ValueError, ("goal_states", "(2, 30)")),
        ({"goal_states": "kettle"}, ValueError, ("goal_states", "kettle")),
        ({"start_state": np.zeros(29)}, ValueError, ("start_state", "(30,)")),
        ({"start_state": np.full(30, 1e6)}, ValueError, ("start_state", "within 10")),
        ({"goal_state": wanted()}, ValueError, ("goal_state", "goal_states")),
    ],
    ids=str,
)
def test_bad_requests_are_named(options, error, shown):
    env = FrankaKitchenEnv(goal_states=2)
    env.reset(seed=0)
    before = env.get_state()
    with refused(error, *shown):
        env.reset(options=options)
    np.testing.assert_equal(env.get_state(), before)


@pytest.mark.parametrize("value", [-1, 17])
def test_a_bad_number_of_goal_states_is_named(value):
    with refused(ValueError, "goal_states"):
        FrankaKitchenEnv(goal_states=value)


def test_goal_states_need_the_argument():
    with refused(ValueError, "build the environment with goal_states"):
        FrankaKitchenEnv().reset(options={"goal_states": wanted()})


PICTURES = {"obs_type": "pixels_agent_pos", "image_size": [24, 32], "render_quality": "fast"}


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize(
    "cameras",
    [
        pytest.param(["workspace"], id="one camera", marks=pytest.mark.full),
        pytest.param(["workspace", "franka/hand"], id="two cameras"),
    ],
)
def test_a_goal_is_shown_as_the_kitchen_looks_there(cameras):
    env = FrankaKitchenEnv(goal_states=2, cameras=cameras, **PICTURES)
    observation, _ = env.reset(seed=0, options={"goal_states": wanted()})
    assert env.observation_space.contains(observation)
    there, _ = FrankaKitchenEnv(cameras=cameras, **PICTURES).reset(seed=0, options={"start_state": wanted()[-1]})
    plain = FrankaKitchenEnv(cameras=cameras, **PICTURES)
    here, _ = plain.reset(seed=0)
    np.testing.assert_equal(observation["goal_pixels"], there["pixels"])
    np.testing.assert_equal(observation["pixels"], here["pixels"])
    state = env.get_state()
    for action in np.random.default_rng(0).uniform(-1, 1, (3, 9)):
        stepped, *_ = env.step(action)
        expected, *_ = plain.step(action)
        np.testing.assert_equal({key: stepped[key] for key in expected}, expected)
        np.testing.assert_equal(stepped["goal_pixels"], observation["goal_pixels"])
    env.reset(seed=1)
    np.testing.assert_equal(env.set_state(state), observation)


@pytest.mark.full
@pytest.mark.rendering
def test_the_suites_own_environment_shows_goals():
    arguments = {"goal_states": 1, "cameras": ["workspace", "franka/hand"], "image_size": [24, 32]}
    environment = suite.load("kitchen", "microwave", task_kwargs={"random": 0, **arguments})
    observation = environment.reset().observation
    env = FrankaKitchenEnv(["microwave"], obs_type="pixels_agent_pos", **arguments)
    env.reset(seed=0)
    assert [*env.present_observation] == [*observation]
    assert [*observation][-4:] == ["goal_pixels/workspace", "goal_pixels/franka/hand", "workspace", "franka/hand"]
    for key, value in env.present_observation.items():
        spec = environment.observation_spec()[key]
        assert (
            (value.shape, value.dtype) == (spec.shape, spec.dtype) == (observation[key].shape, observation[key].dtype)
        )
        if "goal_pixels" in key:
            np.testing.assert_array_equal(value, observation[key])


@pytest.mark.full
@pytest.mark.rendering
def test_vectorised_kitchens_show_their_own_goals():
    arguments = {"tasks_per_episode": (1, 3), "goal_states": 1, "cameras": ["workspace", "franka/hand"], **PICTURES}
    envs = FrankaKitchenVectorEnv(2, num_threads=1, **arguments)
    observations, _ = envs.reset(seed=5, options={"goal_states": [None, wanted(1)]})
    assert envs.observation_space.contains(observations)
    for i in range(2):
        single = FrankaKitchenEnv(**arguments)
        expected, _ = single.reset(seed=5 + i, options={"goal_states": wanted(1)} if i else None)
        np.testing.assert_equal(
            {key: rows[i] for key, rows in observations["goal_pixels"].items()}, expected["goal_pixels"]
        )
        np.testing.assert_equal(
            {key: rows[i] for key, rows in envs.present_observation.items()}, single.present_observation
        )

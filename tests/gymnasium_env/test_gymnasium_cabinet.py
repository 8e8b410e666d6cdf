"""The cabinet through Gymnasium: spaces, infos, seeds, states, copies."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.open_cabinet import TERMS, VARIED
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import OPEN_CABINET_ID, FrankaOpenCabinetEnv


def actions(steps, seed=0):
    return np.random.default_rng(seed).normal(scale=0.03, size=(steps, 8))


@pytest.mark.filterwarnings("ignore:.*Box action space.*")
@pytest.mark.parametrize("drawer", brief(["top", "bottom"], kept=["bottom"]))
def test_gymnasiums_checker_is_content(drawer):
    check_env(gymnasium.make(OPEN_CABINET_ID, drawer=drawer).unwrapped, skip_render_check=True)


def test_spaces_are_those_of_the_system():
    env = gymnasium.make(OPEN_CABINET_ID)
    assert env.observation_space == gymnasium.spaces.Box(-5.0, 5.0, (25,), np.float32)
    assert env.action_space == gymnasium.spaces.Box(-np.inf, np.inf, (8,), np.float32)
    assert env.spec.max_episode_steps == 700
    assert env.metadata["render_fps"] == 100


def test_it_is_the_suites_environment_for_the_same_random_stream():
    env = FrankaOpenCabinetEnv()
    observation, _ = env.reset(seed=5)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(5)))
    plain = suite.load("open_cabinet", "top_drawer", {"random": np.random.RandomState(generator.bit_generator)})
    timestep = plain.reset()
    for action in actions(50):
        np.testing.assert_array_equal(observation, np.concatenate([*timestep.observation.values()]))
        assert_same(env.present_observation, dict(timestep.observation))
        assert list(env.present_observation) == list(timestep.observation)
        assert not any(np.shares_memory(part, observation) for part in env.present_observation.values())
        observation, reward, terminated, _, info = env.step(action)
        timestep = plain.step(action)
        assert (reward, terminated) == (timestep.reward, timestep.last())
        assert {name: info[f"reward/{name}"] for name in TERMS} == plain.task.reward_terms
        if terminated:
            break


def test_the_reward_is_the_sum_of_its_terms_and_infos_keep_their_shape():
    env = FrankaOpenCabinetEnv()
    infos = [env.reset(seed=0)[1]]
    for action in actions(20):
        _, reward, _, _, info = env.step(action)
        assert reward == pytest.approx(sum(info[f"reward/{name}"] for name in TERMS), abs=1e-12)
        infos.append(info)
    assert all(info.keys() == infos[0].keys() for info in infos)
    assert all(info[key].dtype == infos[0][key].dtype for info in infos for key in info)
    assert {info[key].shape for info in infos for key in info} == {()}
    assert [info["episode_step"] for info in infos] == list(range(21))


@pytest.mark.full
def test_the_step_counter_survives_resets_and_is_part_of_the_state():
    env = FrankaOpenCabinetEnv()
    env.reset(seed=0)
    for action in actions(5):
        env.step(action)
    _, info = env.reset()
    assert (env.environment.task.total_steps, info["episode_step"]) == (5, 0)
    other = FrankaOpenCabinetEnv()
    other.reset(options={"state": env.get_state()})
    assert other.environment.task.total_steps == 5


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("arguments", [{}, {"variations": VARIED, "observation_noise": {"handle_offset": 0.01}}])
def test_a_copy_goes_on_where_the_original_stands(duplicate, arguments):
    env = gymnasium.make(OPEN_CABINET_ID, **arguments)
    env.reset(seed=2**40)
    for action in actions(15):
        env.step(action)
    twin = duplicate(env)
    for action in actions(20, seed=1):
        assert_same(env.step(action), twin.step(action))
    assert_same(env.reset(), twin.reset())


def test_an_action_limit_bounds_the_space_and_clips():
    limited, plain = FrankaOpenCabinetEnv(action_limit=0.02), FrankaOpenCabinetEnv()
    assert limited.action_space == gymnasium.spaces.Box(-0.02, 0.02, (8,), np.float32)
    assert_same(limited.reset(seed=0), plain.reset(seed=0))
    assert_same(limited.step(np.full(8, 3.0)), plain.step(np.full(8, 0.02)))


@pytest.mark.parametrize(
    ("arguments", "error", "shown"),
    [
        ({"drawer": "botom"}, ValueError, ["'botom'", "'bottom'"]),
        ({"gripper": "lucky"}, ValueError, ["'lucky'"]),
        ({"action_limit": 0}, ValueError, ["action_limit"]),
        ({"tasks_to_complete": ["kettle"]}, TypeError, ["tasks_to_complete"]),
    ],
)
def test_bad_arguments_are_refused(arguments, error, shown):
    with refused(error, *shown):
        FrankaOpenCabinetEnv(**arguments)


@pytest.mark.parametrize("limit", [None, 1.0])
@pytest.mark.parametrize("action", [np.zeros(9), np.full(8, np.inf), ["up"] * 8])
def test_bad_actions_change_nothing(action, limit):
    env = FrankaOpenCabinetEnv(action_limit=limit)
    env.reset(seed=0)
    state = env.get_state()
    with pytest.raises((ValueError, TypeError), match="action"):
        env.step(action)
    assert_same(env.get_state(), state)


@pytest.mark.rendering
@pytest.mark.parametrize(
    "camera", brief([{}, {"camera_name": "overview"}, {"camera_name": "handle"}], kept=[{"camera_name": "handle"}])
)
def test_pictures_show_something(camera):
    env = FrankaOpenCabinetEnv(render_mode="rgb_array", width=160, height=120, **camera)
    env.reset(seed=0)
    assert env.render().std() > 15
    env.close()

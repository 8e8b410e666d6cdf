"""The environments as LeRobot reads them, without LeRobot: observations, features, attributes, ends of episodes."""

import numpy as np
import pytest
from helpers.errors import refused
from helpers.sweeps import brief_named

from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.lerobot.environments import LeRobotVectorEnv, features_of, make_vector_env
from kitchen_suite.lerobot.observations import LeRobotObservations, dataset_features

STATES = {"obs_type": "environment_state_agent_pos"}
PICTURES = {"obs_type": "pixels_agent_pos", "image_size": [24, 32], "render_quality": "fast"}
# What LeRobot's rollouts pass to each reset.
OPTIONS = {"lerobot_new_rollout": True}


def spec_of(task_kwargs=STATES, *, domain_name="kitchen", task_name=None, max_episode_steps=None):
    return EnvironmentSpec.make(
        domain_name=domain_name, task_name=task_name, task_kwargs=task_kwargs, max_episode_steps=max_episode_steps
    )


@pytest.fixture(scope="module")
def env():
    """Two kettles, whose episodes have three steps."""
    env = make_vector_env(spec_of(task_name="kettle", max_episode_steps=3), 2, num_threads=1)
    yield env
    env.close()


@pytest.mark.full
def test_numbers_are_those_of_the_suites_environments(env):
    suite_vector = spec_of(task_name="kettle", max_episode_steps=3).make_vector_env(2, 1, "SameStep")
    observations, infos = env.reset(seed=[5, 6], options=OPTIONS)
    expected, _ = suite_vector.reset(seed=[5, 6])
    assert env.observation_space.contains(observations)
    assert [*observations] == ["agent_pos", "environment_state"]
    assert infos["is_success"].tolist() == [False, False]
    for _ in range(4):  # Beyond the end of an episode.
        np.testing.assert_equal(observations, {key: expected[key] for key in observations})
        action = env.action_space.sample()
        observations, *results, _ = env.step(action)
        expected, *others, _ = suite_vector.step(action)
        np.testing.assert_equal(results, others)
    suite_vector.close()


def test_an_episodes_end_has_its_infos_and_its_observation(env):
    env.reset(seed=[5, 6], options=OPTIONS)
    zeros = np.zeros((2, 9))
    for _ in range(2):
        *_, infos = env.step(zeros)
        assert "final_info" not in infos
    observations, _, _, truncations, infos = env.step(zeros)
    assert truncations.all()
    assert infos["final_info"]["is_success"].tolist() == [False, False]
    assert infos["final_info"]["episode_step"].tolist() == [3, 3]
    assert infos["episode_step"].tolist() == [0, 0]
    for i in range(2):
        last = infos["final_obs"][i]
        assert env.single_observation_space.contains(last)
        assert not np.array_equal(last["agent_pos"], observations["agent_pos"][i])


def test_lerobot_calls_attributes_and_films(env):
    assert env.call("_max_episode_steps") == (3, 3)
    assert env.call("task") == env.call("task_description") == ("move the kettle to the top left burner",) * 2
    assert env.get_attr("task") == env.call("task")
    assert env.unwrapped.metadata["render_fps"] == 12
    with refused(AttributeError, "'tsak'"):
        env.call("tsak")
    with pytest.raises(TypeError, match="reset takes no arguments"):
        env.call("reset", seed=1)
    # Without a render mode films are black.
    env.reset(seed=1)
    films = env.call("render")
    assert (len(films), np.stack(films[:1]).shape) == (2, (1, 64, 64, 3))
    assert not films[-1].any()


def test_an_episode_does_not_depend_on_earlier_ones_in_the_environment():
    env = make_vector_env(spec_of(domain_name="open_cabinet", max_episode_steps=5), 1, num_threads=1)
    action = np.full(env.action_space.shape, 0.5)
    returns = []
    for _ in range(2):
        env.reset(seed=[3], options=OPTIONS)
        # The weights of penalties depend on the number of steps since the run began.
        assert env.environments.total_steps.tolist() == [0]
        returns.append([env.step(action)[1].tolist() for _ in range(4)])
    assert returns[0] == returns[1]
    env.close()


@pytest.mark.full
def test_features_are_those_of_the_spaces():
    features, fps = features_of(spec_of(task_name="random_2"))
    assert fps == 12
    assert [(each.column, each.kind, each.shape) for each in features] == [
        ("observation.state", "STATE", (18,)),
        ("observation.environment_state", "ENV", (41 + 7,)),
        ("action", "ACTION", (9,)),
    ]
    state, environment_state, _ = (each.names for each in features)
    assert state[0] == "franka/joint_positions[0]"
    assert environment_state[-1] == "requested_tasks[6]"
    assert not {*state} & {*environment_state}


def test_pictures_and_states_are_features_beside_each_other():
    kwargs = {**PICTURES, "obs_type": "pixels_environment_state_agent_pos", "extra_observables": ["microwave/pose"]}
    features, _ = features_of(spec_of(kwargs, domain_name="microwave_table"))
    shapes = {each.kind: each.shape for each in features}
    assert shapes == {"STATE": (18,), "ENV": (5 + 7,), "VISUAL": (24, 32, 3), "ACTION": (8,)}


def test_the_tasks_asked_follow_the_environment_state():
    env = make_vector_env(spec_of(task_name="random_2"), 2, num_threads=1)
    observations, infos = env.reset(seed=[1, 2])
    asked = observations["environment_state"][:, 41:]
    np.testing.assert_array_equal(asked, infos["requested_tasks_mask"])
    assert asked.sum(axis=1).tolist() == [2, 2]
    env.close()


CAMERAS = {"one camera": ["overview"], "two cameras": ["overview", "franka/hand"]}


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize("cameras", brief_named(CAMERAS, kept=["two cameras"]))
def test_pictures_are_by_camera_also_with_one_camera(cameras):
    single = suite_env(spec_of({**PICTURES, "cameras": cameras}, domain_name="microwave_table").make_environment())
    observations = LeRobotObservations(single)
    found = observations(single.reset(seed=1)[0])
    assert observations.space.contains(found)
    names = [camera.replace("/", "_") for camera in cameras]
    assert [*found["pixels"]] == names
    assert found["pixels"][names[-1]].max() > 0
    features = {each.column: each.shape for each in observations.features if each.kind == "VISUAL"}
    assert features == {f"observation.images.{name}": (24, 32, 3) for name in names}
    assert dataset_features(observations.features)["observation.images.overview"]["dtype"] == "image"
    single.close()


@pytest.mark.parametrize(
    ("task_kwargs", "shown"),
    [
        ({}, ["obs_type", "'environment_state_agent_pos'", "'pixels_agent_pos'"]),
        ({**PICTURES, "depth": True}, ["LeRobot's policies do not read depth: leave it out"]),
    ],
)
def test_other_observations_are_refused(task_kwargs, shown):
    with refused(ValueError, *shown):
        features_of(spec_of(task_kwargs, domain_name="microwave_table"))


@pytest.mark.full
@pytest.mark.rendering
def test_pictures_of_goals_are_refused():
    kwargs = {"goal_states": 1, "obs_type": "pixels_agent_pos", "image_size": [8, 8], "cameras": ["workspace"]}
    with refused(ValueError, "LeRobot's policies do not read goal_pixels: leave it out"):
        features_of(spec_of(kwargs, domain_name="kitchen"))


def test_other_autoreset_modes_are_refused():
    environments = spec_of(domain_name="open_cabinet").make_vector_env(1, 1)
    with refused(ValueError, "autoreset_mode", "'SameStep'", "'Disabled'"):
        LeRobotVectorEnv(environments)
    environments.close()

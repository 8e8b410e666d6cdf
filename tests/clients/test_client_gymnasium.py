"""Gymnasium's own tools take the kitchen as it is: its checker, its vector environments, its video recorder."""

import warnings

import gymnasium
import imageio.v3 as imageio
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_checker import data_equivalence as same
from gymnasium.wrappers import RecordVideo
from helpers.sweeps import brief

from kitchen_suite.gymnasium_env import FrankaKitchenEnv

pytestmark = pytest.mark.clients

KITCHEN = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1"
# The microwave's goal lies within its threshold from the start: it pays in the first step, the kettle never does.
EASY = {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [-0.2]}}


def complaints(environment, **options):
    """Returns the checker's warnings, except that observations are unbounded, as they are in the original."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(environment, **options)
    messages = [str(warning.message) for warning in caught]
    return [message for message in messages if "Box observation space" not in message or "infinity" not in message]


@pytest.mark.parametrize("info_format", ["lists", "arrays"])
@pytest.mark.parametrize("goal_format", ["dict", "flat"])
def test_the_checker_has_nothing_to_say(goal_format, info_format):
    environment = gymnasium.make(KITCHEN, goal_format=goal_format, info_format=info_format)
    assert environment.spec.id == "KitchenSuite/FrankaKitchen-v1"
    # The check of rendering would try the mode `human`, which opens a window; the others have a test of their own.
    assert complaints(environment.unwrapped, skip_render_check=True) == []
    environment.close()


@pytest.mark.rendering
@pytest.mark.parametrize("render_mode", ["rgb_array", "depth_array"])
def test_the_checker_has_nothing_to_say_about_pictures(render_mode):
    environment = FrankaKitchenEnv(render_mode=render_mode, width=64, height=48)
    # Built without a spec, only the environment's own mode is tried.
    found = complaints(environment)
    assert [message for message in found if "not having a spec" not in message] == []
    assert environment.render().shape[:2] == (48, 64)
    environment.close()


@pytest.mark.rendering
def test_a_recorded_video_runs_at_the_speed_of_the_kitchen(tmp_path):
    environment = gymnasium.make(KITCHEN, render_mode="rgb_array", width=64, height=48, max_episode_steps=12)
    environment = RecordVideo(environment, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0)
    environment.reset(seed=0)
    truncated = False
    while not truncated:
        *_, truncated, _ = environment.step(environment.action_space.sample())
    environment.close()
    (video,) = tmp_path.glob("videos/*.mp4")
    frames = imageio.imread(video)
    # The picture of the reset and of each step; moviepy's rounding may lose the last.
    assert len(frames) in (12, 13)
    assert frames.shape[1:] == (48, 64, 3)
    assert frames[0].std() > 20
    metadata = imageio.immeta(video)
    assert metadata["fps"] == 12.5
    assert metadata["duration"] == pytest.approx(len(frames) / 12.5, abs=0.01)


# Worker processes forked, and started afresh, where nothing has imported the adapter before.
VECTORS = [("sync", {}), ("async", {}), ("async", {"context": "spawn"})]


@pytest.mark.parametrize(("mode", "vector_options"), VECTORS, ids=["sync", "async", "spawned"])
@pytest.mark.parametrize("goal_format", brief(["dict", "flat"], ["flat"]))
def test_each_part_of_a_vector_is_a_single_environment_of_the_next_seed(mode, vector_options, goal_format):
    seed, count, steps = 2**33 + 1, 2, 12
    options = {"goal_format": goal_format, "info_format": "arrays", **EASY}
    vector = gymnasium.make_vec(
        KITCHEN, num_envs=count, vectorization_mode=mode, vector_kwargs=vector_options, **options
    )
    singles = [gymnasium.make(KITCHEN, **options) for _ in range(count)]
    rng = np.random.default_rng(0)
    vector.reset(seed=0)
    observation, info = vector.reset(seed=seed)
    for i, single in enumerate(singles):
        assert_part(observation, info, i, *single.reset(seed=seed + i))
    paid = 0.0
    for _ in range(steps):
        actions = rng.uniform(-1, 1, vector.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, info = vector.step(actions)
        assert vector.observation_space.contains(observation)
        for i, single in enumerate(singles):
            expected, *end, single_info = single.step(actions[i])
            assert (reward[i], terminated[i], truncated[i]) == tuple(end)
            assert_part(observation, info, i, expected, single_info)
            paid += reward[i]
    assert paid == count
    for environment in (vector, *singles):
        environment.close()


def assert_part(observation, info, i, single_observation, single_info):
    assert same({key: part(value, i) for key, value in observation.items()}, single_observation, exact=True)
    for key, value in single_info.items():
        assert info[f"_{key}"][i], key
        assert np.array_equal(info[key][i], value), key
        assert info[key].shape == (info[key].shape[0], *np.shape(value)), key


def part(value, i):
    return {key: inner[i] for key, inner in value.items()} if isinstance(value, dict) else value[i]


def test_a_vector_of_lists_gives_the_original_info_entries():
    vector = gymnasium.make_vec(KITCHEN, num_envs=2, vectorization_mode="sync", **EASY)
    vector.reset(seed=0)
    *_, info = vector.step(vector.action_space.sample())
    assert [*info["tasks_to_complete"]] == [["kettle"]] * 2
    assert [*info["step_task_completions"]] == [["microwave"]] * 2
    assert [*info["episode_task_completions"]] == [["microwave"]] * 2
    vector.close()


def test_a_vector_resets_itself_and_its_infos_keep_their_shapes():
    vector = gymnasium.make_vec(
        KITCHEN, num_envs=2, vectorization_mode="sync", max_episode_steps=3, info_format="arrays", **EASY
    )
    _, start = vector.reset(seed=0)
    shapes = {key: (value.shape, value.dtype) for key, value in start.items()}
    steps, ends, rewards = [], [], []
    for _ in range(9):
        _, reward, terminated, truncated, info = vector.step(vector.action_space.sample())
        assert {key: (value.shape, value.dtype) for key, value in info.items()} == shapes
        assert not terminated.any()
        steps.append(info["episode_step"].tolist())
        ends.append(truncated.tolist())
        rewards.append(reward.tolist())
    # Three steps, then one that resets: Gymnasium's way by default.
    assert steps == [[i % 4, i % 4] for i in range(1, 10)]
    assert ends == [[i % 4 == 3] * 2 for i in range(1, 10)]
    assert rewards == [[float(i % 4 == 1)] * 2 for i in range(1, 10)]
    vector.close()

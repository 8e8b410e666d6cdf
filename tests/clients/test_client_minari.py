"""Minari records episodes of the kitchen, infos included, and replays them to the bit."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

pytestmark = pytest.mark.clients

KITCHEN = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1"
STEPS = 20
# Seeds below and above 32 bits, and one that Minari draws itself (64 bits).
SEEDS = (5, 2**40 + 1, None)
# The microwave's goal lies within its threshold from the start: it pays in the first step, the kettle never does.
EASY = {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [-0.2]}}
INFOS = {
    "tasks_to_complete_mask": ((2,), bool),
    "step_task_completions_mask": ((2,), bool),
    "episode_task_completions_mask": ((2,), bool),
    "completion_steps": ((2,), np.int64),
    "task_distances": ((2,), np.float64),
    "is_success": ((), bool),
    "episode_step": ((), np.int64),
}


@pytest.fixture(params=["dict", "flat"])
def dataset(request, tmp_path, monkeypatch):
    """Three recorded episodes, loaded from disk."""
    import minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    environment = gymnasium.make(
        KITCHEN, goal_format=request.param, info_format="arrays", max_episode_steps=STEPS, **EASY
    )
    with warnings.catch_warnings():
        # It says that no other environment was named for evaluation.
        warnings.filterwarnings("ignore", "`eval_env` is set to None")
        return recorded(minari, environment)


def recorded(minari, environment):
    collector = minari.DataCollector(environment, record_infos=True)
    for seed in SEEDS:
        collector.reset(seed=seed)
        truncated = False
        while not truncated:
            *_, truncated, _ = collector.step(collector.action_space.sample())
    collector.create_dataset(
        "kitchen/test-v0",
        algorithm_name="random",
        description="three short episodes",
        author="nobody",
        author_email="nobody@example.org",
        code_permalink="https://example.org",
    )
    collector.close()
    return minari.load_dataset("kitchen/test-v0")


def test_what_was_recorded_is_read_back(dataset):
    assert (dataset.total_episodes, dataset.total_steps) == (3, 3 * STEPS)
    for episode in dataset:
        assert episode.actions.shape == (STEPS, 9)
        assert episode.rewards.tolist() == [1.0] + [0.0] * (STEPS - 1)
        assert episode.truncations.tolist() == [False] * (STEPS - 1) + [True]
        assert not episode.terminations.any()
        assert episode.observations["observation"].shape == (STEPS + 1, 59)
        assert episode.observations["observation"].dtype == np.float64


def test_infos_are_recorded_with_the_step_they_belong_to(dataset):
    for episode in dataset:
        found = {key: (value.shape, value.dtype) for key, value in episode.infos.items()}
        assert found == {key: ((STEPS + 1, *shape), dtype) for key, (shape, dtype) in INFOS.items()}
        assert episode.infos["episode_step"].tolist() == [*range(STEPS + 1)]
        assert episode.infos["completion_steps"].tolist() == [[-1, -1]] + [[1, -1]] * STEPS
        assert np.flatnonzero(episode.infos["step_task_completions_mask"][:, 0]).tolist() == [1]


def test_the_recovered_environment_replays_the_episodes_to_the_bit(dataset):
    environment = dataset.recover_environment()
    assert environment.observation_space == dataset.observation_space
    assert environment.spec.max_episode_steps == STEPS
    seeds = [stored["seed"] for stored in dataset.storage.get_episode_metadata(dataset.episode_indices)]
    assert seeds[:2] == [5, 2**40 + 1]
    # In another order than they were recorded in: each follows from its own seed alone.
    for seed, episode in reversed([*zip(seeds, dataset, strict=True)]):
        observation, info = environment.reset(seed=seed)
        assert_recorded(episode, 0, observation, info)
        for i, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, info = environment.step(action)
            assert_recorded(episode, i + 1, observation, info)
            assert reward == episode.rewards[i]
            assert (terminated, truncated) == (episode.terminations[i], episode.truncations[i])
    environment.close()


def assert_recorded(episode, i, observation, info):
    assert data_equivalence(observation, at(episode.observations, i), exact=True)
    assert {*info} == {*episode.infos}
    assert all(np.array_equal(value, episode.infos[key][i]) for key, value in info.items())


def at(values, i):
    return {key: at(value, i) for key, value in values.items()} if isinstance(values, dict) else values[i]

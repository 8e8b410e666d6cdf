"""Episodes played in vectorised environments are those of one environment alone, and cost no more control steps."""

import collections
import contextlib

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.episodes import played_together, rollout_of

from kitchen_suite.episodes.play import VectorRollout
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies import PolicyRef
from kitchen_suite.vector_env import FrankaOpenCabinetVectorEnv

EPISODES, LIMIT = 5, 12


class Jerks:
    """Moves the arm of episodes with odd seeds too fast, which terminates them, and of the others not at all."""

    def __init__(self, num_envs):
        self.labels = {"is_fast": np.zeros(num_envs, bool)}
        self._actions = np.zeros((num_envs, 8))

    def start(self, i, seed, options):
        self._actions[i] = 4.0 * (seed % 2)

    def act(self, step):
        self.labels = {"is_fast": self._actions.any(axis=1)}
        return self._actions


def play(num_envs, monkeypatch):
    """Plays the episodes; returns their rewards by index, and the masks of all control steps `(steps, num_envs)`."""
    environments = FrankaOpenCabinetVectorEnv(
        num_envs, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=LIMIT, num_threads=1
    )
    masks, step_some = [], environments.step_some

    def recorded(actions, mask):
        masks.append(mask.copy())
        return step_some(actions, mask)

    monkeypatch.setattr(environments, "step_some", recorded)
    with contextlib.closing(environments):
        waiting = collections.deque(enumerate(range(EPISODES)))
        episodes = VectorRollout(environments, Jerks(num_envs)).play(waiting)
        arrays = {index: episode.collect(environments.composer_task).arrays for index, episode in episodes}
    for index, each in arrays.items():
        np.testing.assert_array_equal(each["label/is_fast"], np.full(len(each["reward"]), index % 2 == 1))
    rewards = {index: each["reward"] for index, each in arrays.items()}
    return rewards, np.array(masks)


@pytest.mark.parametrize("num_envs", [2, EPISODES, 7])
def test_environments_without_an_episode_are_not_simulated(monkeypatch, num_envs):
    rewards, masks = play(num_envs, monkeypatch)
    alone, _ = play(1, monkeypatch)
    assert sorted(rewards) == sorted(alone) == [*range(EPISODES)]
    for index, expected in alone.items():
        np.testing.assert_array_equal(rewards[index], expected)
    lengths = [len(rewards[index]) for index in range(EPISODES)]
    assert max(lengths[1::2]) < LIMIT == min(lengths[::2])
    assert masks.sum() == sum(lengths) < masks.size


@pytest.mark.full
def test_labels_of_policies_are_those_of_episodes_played_alone():
    spec = EnvironmentSpec.make(domain_name="kitchen", task_name="kettle", task_kwargs={}, max_episode_steps=LIMIT)
    episodes = spec.episodes(PolicyRef.parse("takeover(latest=8)"), seed=0)
    alone = rollout_of(episodes)
    played = played_together(episodes, EPISODES, 3)
    for index, episode in played.items():
        expected = alone.play(index, index)
        assert episode.labels.keys() == {"label/is_intervention"}
        np.testing.assert_array_equal(episode.labels["label/is_intervention"], expected.arrays["label/is_intervention"])
        np.testing.assert_array_equal(episode.arrays["action"], expected.arrays["action"].astype(np.float32))
    assert len({int(episode.labels["label/is_intervention"].sum()) for episode in played.values()}) > 1

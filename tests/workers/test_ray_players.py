"""What runs in a worker's process, without Ray."""

import functools
import pickle

import numpy as np
import pytest

from kitchen_suite.recordings.record_worker import RecordWorker
from kitchen_suite.recordings.spec import RecordingSpec
from kitchen_suite.rollouts.rollout_worker import RolloutWorker
from kitchen_suite.tasks.open_cabinet import reward as drawer_reward
from kitchen_suite.vector_env import base as vector_base
from kitchen_suite.versions import installed_versions
from kitchen_suite.workers.worker import ClusterError, Worker

EPISODES = [(index, 3 + index) for index in range(6)]


@pytest.fixture
def recipe():
    return RecordingSpec.make(
        domain_name="kitchen", task_name="kettle", task_kwargs={}, policy="random", seed=3, max_episode_steps=5
    )


@pytest.fixture
def cabinet():
    """Its episodes end at different times."""
    return RecordingSpec.make(
        domain_name="open_cabinet",
        task_name="top_drawer",
        task_kwargs={},
        policy="random",
        seed=3,
        max_episode_steps=None,
    )


def played(player, *handed_out):
    """All that comes of handing out episodes a few at a time: the next ones when the last ones have ended."""
    return dict(
        player.play(more if first else []) for more in handed_out for first in [True] + [False] * (len(more) - 1)
    )


@pytest.mark.parametrize("split", [[6], [1, 5], [3, 1, 2]])
def test_an_episode_is_the_same_whenever_a_worker_is_given_it(cabinet, split):
    alone = played(RecordWorker(cabinet, 1, 1), *([episode] for episode in EPISODES))
    parts = [EPISODES[sum(split[:i]) : sum(split[: i + 1])] for i in range(len(split))]
    together = played(RecordWorker(cabinet, 3, 1), *parts)
    assert alone.keys() == together.keys() == {index for index, _ in EPISODES}
    for index, seed in EPISODES:
        assert (together[index].index, together[index].seed) == (index, seed)
        assert alone[index].arrays.keys() == together[index].arrays.keys()
        for name, array in alone[index].arrays.items():
            np.testing.assert_array_equal(array, together[index].arrays[name], name)


def test_what_is_handed_out_late_is_played_at_once_by_all_that_is_idle(recipe, monkeypatch):
    step, steps = vector_base.SuiteVectorEnv.step, []
    monkeypatch.setattr(vector_base.SuiteVectorEnv, "step", lambda *args: steps.append(1) or step(*args))
    player = RecordWorker(recipe, 3, 1)
    played(player, EPISODES[:1])
    steps.clear()
    played(player, EPISODES[1:4])
    assert len(steps) <= 6


def test_a_worker_tells_of_an_episode_whose_physics_diverged(recipe, monkeypatch):
    step = vector_base.SuiteVectorEnv.step

    def diverge(self, actions):
        observations, rewards, _, truncations, infos = step(self, actions)
        return observations, rewards, np.array([True]), truncations, infos | {"physics_error": np.array([True])}

    player = RecordWorker(recipe, 1, 1)
    with monkeypatch.context() as patch:
        patch.setattr(vector_base.SuiteVectorEnv, "step", diverge)
        assert player.play(EPISODES[:2]) == (0, None)
    index, episode = player.play([])
    assert (index, episode.steps) == (1, 5)


def test_rewards_of_a_rollout_do_not_depend_on_what_the_worker_played_before(monkeypatch):
    # The second episode of an environment would begin with the greater penalties.
    monkeypatch.setattr(drawer_reward, "LATE_STAGE", 2)
    player = RolloutWorker("open_cabinet", "top_drawer", {"time_limit": 0.5}, "random")
    first, again = (player.play([(0, 7)])[1] for _ in range(2))
    np.testing.assert_array_equal(first.rewards, again.rewards)


def start(build, versions):
    Worker().start(pickle.dumps(build), versions)


def test_a_worker_with_other_versions_is_refused(recipe):
    versions = installed_versions()
    start(functools.partial(RecordWorker, recipe, 1, 1), versions)
    there = f"it has mujoco {versions['mujoco']} in place of 3.0.0, so that its episodes would be others"
    with pytest.raises(ClusterError, match=there):
        start(functools.partial(RecordWorker, recipe, 1, 1), versions | {"mujoco": "3.0.0"})


def test_a_worker_that_lacks_the_policys_module_says_so():
    build = functools.partial(RolloutWorker, "kitchen", "kettle", {}, "nowhere:act")
    with pytest.raises(ClusterError, match=r"a worker on .* cannot start: .*No module named 'nowhere'"):
        start(build, installed_versions())

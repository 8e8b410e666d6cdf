"""Episode runners, as they run in a worker's process, without Ray."""

import dataclasses
import functools
import pickle

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite.episodes.play import SingleRunner, VectorRunner
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.tasks.open_cabinet import reward
from kitchen_suite.vector_env.base import SuiteVectorEnv
from kitchen_suite.versions import installed_versions
from kitchen_suite.workers.pool import ClusterError, Worker

EPISODES = [(index, 3 + index) for index in range(6)]


def make_spec(domain_name, task_name, seeding="gymnasium", max_episode_steps=None):
    spec = EnvironmentSpec.make(
        domain_name=domain_name, task_name=task_name, task_kwargs={}, max_episode_steps=max_episode_steps
    )
    return spec.episodes(policy="random", seed=3, seeding=seeding)


@pytest.fixture(scope="module")
def kitchen():
    return make_spec("kitchen", "kettle", max_episode_steps=5)


@pytest.fixture(scope="module")
def open_cabinet():
    """Its episodes end at different times."""
    return make_spec("open_cabinet", "top_drawer")


@pytest.fixture(scope="module")
def alone(open_cabinet):
    """Episodes that were run one at a time."""
    return run_all(VectorRunner(open_cabinet, 1, 1), *([episode] for episode in EPISODES))


def run_all(runner, *groups):
    """Returns results by index, where each group of episodes is assigned when the one before has ended."""
    return dict(runner.run(group if first else []) for group in groups for first in [True] + [False] * (len(group) - 1))


@pytest.mark.parametrize("split", [[6], [1, 5], [3, 1, 2]])
def test_an_episode_is_the_same_whenever_a_worker_is_assigned_it(open_cabinet, alone, split):
    groups = [EPISODES[sum(split[:i]) : sum(split[: i + 1])] for i in range(len(split))]
    together = run_all(VectorRunner(open_cabinet, 3, 1), *groups)
    assert alone.keys() == together.keys() == {index for index, _ in EPISODES}
    for index, seed in EPISODES:
        assert (together[index].index, together[index].seed) == (index, seed)
        assert alone[index].arrays.keys() == together[index].arrays.keys()
        for name, array in alone[index].arrays.items():
            np.testing.assert_array_equal(array, together[index].arrays[name], name)


def test_episodes_that_are_assigned_late_run_at_once_in_all_idle_environments(kitchen, monkeypatch):
    step, steps = SuiteVectorEnv.step_some, []
    monkeypatch.setattr(SuiteVectorEnv, "step_some", lambda *args: steps.append(1) or step(*args))
    runner = VectorRunner(kitchen, 3, 1)
    run_all(runner, EPISODES[:1])
    steps.clear()
    run_all(runner, EPISODES[1:4])
    assert 5 <= len(steps) <= 6


def test_an_episode_whose_physics_diverged_has_no_result(kitchen, monkeypatch):
    step = SuiteVectorEnv.step_some

    def diverge(self, actions, mask):
        observations, rewards, _, truncations, infos = step(self, actions, mask)
        return observations, rewards, np.array([True]), truncations, infos | {"physics_error": np.array([True])}

    runner = VectorRunner(kitchen, 1, 1)
    with monkeypatch.context() as patch:
        patch.setattr(SuiteVectorEnv, "step_some", diverge)
        assert runner.run(EPISODES[:2]) == (0, None)
    index, episode = runner.run([])
    assert (index, episode.steps) == (1, 5)


def test_rewards_of_a_rollout_do_not_depend_on_what_the_worker_ran_before(monkeypatch):
    # The second episode of an environment would begin with the greater penalties.
    monkeypatch.setattr(reward, "LATE_STAGE", 2)
    runner = SingleRunner(make_spec("open_cabinet", "top_drawer", "dm_control", max_episode_steps=50))
    first, again = (runner.run([(0, 7)])[1] for _ in range(2))
    np.testing.assert_array_equal(first.arrays["reward"], again.arrays["reward"])


def start(build, versions):
    Worker().start(pickle.dumps(build), versions)


def test_a_worker_with_other_versions_is_refused(kitchen):
    versions = installed_versions()
    start(functools.partial(VectorRunner, kitchen, 1, 1), versions)
    message = f"it has mujoco {versions['mujoco']} instead of 3.0.0, so its episodes would differ"
    with pytest.raises(ClusterError, match=message):
        start(functools.partial(VectorRunner, kitchen, 1, 1), versions | {"mujoco": "3.0.0"})


def test_a_worker_that_lacks_the_policys_module_says_so(kitchen):
    build = functools.partial(SingleRunner, dataclasses.replace(kitchen, policy="nowhere:act"))
    with refused(ClusterError, "'nowhere'"):
        start(build, installed_versions())

"""Episodes that go back: what is left of them is as if they had never gone otherwise."""

import dataclasses

import numpy as np
import pytest
from helpers.sweeps import brief

from kitchen_suite.commands import replay
from kitchen_suite.episodes import play as rollouts
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.play import RewindableRollout, SingleRollout
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef

LIMIT = 30
KINDS = {
    "kitchen": {"task_name": "random_4", "task_kwargs": {"variations": ["start", "push"]}},
    "fast kitchen": {"task_name": "kettle", "task_kwargs": {"physics": "fast", "control_mode": "ee_delta_pose"}},
    "cabinet": {"domain_name": "open_cabinet"},
    "kitchens": {"domain_name": "kitchens", "task_kwargs": {"variations": ["start", "push"]}},
}


class Scripted:
    """Acts by the rows of an array, one after the other; `step` may be set back."""

    def __init__(self, rows):
        self.rows, self.step, self.labels = rows, 0, {"is_intervention": True}

    def __call__(self, timestep):
        self.step += 1
        return self.rows[self.step - 1]


def spec_of(domain_name="kitchen", task_name=None, task_kwargs=None):
    environments = EnvironmentSpec.make(domain_name, task_name, task_kwargs or {}, LIMIT)
    return environments.episodes(PolicyRef.parse("zero"), seed=0)


def played(rollout, policy, backs):
    """The arrays of an episode that goes back by some control steps when it has made some."""
    rollout.start(3)
    while not rollout.buffer.has_ended:
        rollout.step()
        if count := backs.pop(rollout.buffer.steps, 0):
            assert rollout.rewind(count) == count
    return rollout.buffer.arrays()


@pytest.mark.full
@pytest.mark.parametrize("kind", brief(KINDS, ["kitchen"], full=KINDS))
def test_what_is_left_is_as_if_it_had_never_gone_otherwise(kind, tmp_path):
    spec = spec_of(**KINDS[kind])
    size = suite_env(spec.make_environment()).action_space.shape[0]
    rows = np.random.default_rng(0).uniform(-0.1, 0.1, (90, size)).astype(np.float32)
    one = RewindableRollout(spec, lambda environment, generator: Scripted(rows))
    arrays = played(one, None, {10: 4, 20: 20, LIMIT: 5})
    assert len(arrays["reward"]) == LIMIT
    assert arrays["truncation"].tolist() == [False] * (LIMIT - 1) + [True]
    other = SingleRollout(spec, lambda environment, generator: Scripted(arrays["action"]))
    plain = other.play(0, 3).arrays
    assert arrays.keys() == plain.keys()
    for name, array in plain.items():
        np.testing.assert_array_equal(arrays[name], array, name)

    # It is saved and replayed as any recording.
    folder = Recording.claim(tmp_path / "runs", dataclasses.replace(spec, policy="teleop", seed=3))
    episode = Episode(index=0, seed=3, arrays=arrays)
    metrics = suite_env(one.environment).composer_task.records.metrics(episode.last_info)
    folder.append(dataclasses.replace(episode, metrics=metrics))
    assert replay.main([str(tmp_path / "runs")]) == 0


def test_it_goes_back_no_further_than_states_are_kept(monkeypatch):
    monkeypatch.setattr(rollouts, "REWIND_STEPS", 5)
    rollout = RewindableRollout(spec_of(domain_name="open_cabinet"), PolicyRef.parse("zero").builder())
    rollout.start(0)
    assert rollout.rewind(3) == 0
    for _ in range(8):
        rollout.step()
    assert rollout.rewind(100) == 5
    assert (rollout.buffer.steps, rollout.rewind(1)) == (3, 0)
    rollout.step()
    assert rollout.rewind(1) == 1

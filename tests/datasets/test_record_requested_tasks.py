"""Recordings of episodes that ask for some of the configured tasks."""

import dataclasses
from pathlib import Path

import minari
import numpy as np
import pytest

from kitchen_suite.commands import convert, record, replay
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.replay import replay_episode
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

pytestmark = pytest.mark.usefixtures("folder")

ID = "kitchen-suite/asked-v0"
RECORD = ["--output=runs", "--task_name=random_3", "--num_envs=2", "--num_threads=1", "--seed=3"]


def recorded():
    folder = Recording.open(Path("runs"))
    return folder.spec, [folder.load(index) for index in folder.indices]


@pytest.mark.full
def test_recordings_hold_the_tasks_asked_and_replay_to_the_bit(capsys):
    assert record.main([*RECORD, "--num_episodes=4", "--max_episode_steps=3"]) == 0
    assert convert.main(["runs", f"--dataset={ID}"]) == 0
    _, episodes = recorded()
    for episode in episodes:
        masks, order = episode.arrays["observation/requested_tasks"], episode.arrays["info/requested_order"][0]
        assert masks.shape == (4, 7)
        assert (masks == masks[0]).all()
        np.testing.assert_array_equal(masks[0], order >= 0)
        names = [DEFAULT_TASKS[index] for index in np.argsort(order)[-3:]]
        assert episode.instruction == ", then ".join(GOALS[name].instructions[0] for name in names)
    assert len({episode.instruction for episode in episodes}) > 1
    held = minari.load_dataset(ID)[1].observations["requested_tasks"]
    np.testing.assert_array_equal(held, episodes[1].arrays["observation/requested_tasks"])
    capsys.readouterr()
    assert replay.main(["runs", "--episodes=all"]) == 0
    assert "4 of 4 episodes are equal" in capsys.readouterr().out


@pytest.mark.full
def test_goals_that_are_not_asked_are_not_reached():
    assert record.main([*RECORD, "--num_episodes=1", "--max_episode_steps=2", '--task_kwargs={"threshold": 9}']) == 0
    spec, (episode,) = recorded()
    task = spec.make_environment().unwrapped.composer_task
    names, reached = task.records.goals_reached(episode.arrays)
    np.testing.assert_array_equal(reached[-1], episode.arrays["info/requested_tasks_mask"][0])
    assert names == DEFAULT_TASKS
    bad = {**episode.arrays, "info/requested_order": np.full((2, 7), 3)}
    with pytest.raises(ValueError, match="place of each of 7 tasks"):
        replay_episode(spec.make_environment(), dataclasses.replace(episode, arrays=bad), spec.seeding)

"""Recordings of episodes that ask for some of the configured tasks."""

import dataclasses
from pathlib import Path

import minari
import numpy as np
import pytest

from kitchen_suite.commands.commands import record, replay
from kitchen_suite.datasets.replay import replay as play_again
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS

pytestmark = pytest.mark.usefixtures("folder")

ID = "kitchen-suite/asked-v0"
RECORD = ["--output=runs", "--task_name=random_3", "--num_envs=2", "--num_threads=1", "--seed=3"]


def recorded():
    folder = RecordingFolder.open(Path("runs"))
    return folder.spec, [folder.load(index) for index in folder.indices]


def test_recordings_hold_the_tasks_asked_and_replay_to_the_bit(capsys):
    arguments = ["--num_episodes=4", "--max_episode_steps=3", f"--dataset={ID}"]
    assert record.main([*RECORD, *arguments]) == 0
    spec, episodes = recorded()
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
    for source in ("runs", ID):
        capsys.readouterr()
        assert replay.main([source, "--episodes=all"]) == 0
        assert "4 of 4 episodes are equal" in capsys.readouterr().out
    # Without its seed, an episode asks for the same tasks again.
    again = play_again(spec.make_environment(), dataclasses.replace(episodes[2], seed=None), spec.seeding)
    for key in ("observation/requested_tasks", "info/requested_order", "reward"):
        np.testing.assert_array_equal(again.arrays[key], episodes[2].arrays[key])
    assert again.instruction == episodes[2].instruction


@pytest.mark.thorough
def test_goals_that_are_not_asked_are_not_reached():
    assert record.main([*RECORD, "--num_episodes=1", "--max_episode_steps=2", '--task_kwargs={"threshold": 9}']) == 0
    spec, (episode,) = recorded()
    task = spec.make_environment().unwrapped.composer_task
    names, reached = task.records.goals_reached(episode.arrays)
    np.testing.assert_array_equal(reached[-1], episode.arrays["info/requested_tasks_mask"][0])
    assert names == DEFAULT_TASKS
    bad = {**episode.arrays, "info/requested_order": np.full((2, 7), 3)}
    with pytest.raises(ValueError, match="place of each of 7 tasks"):
        play_again(spec.make_environment(), dataclasses.replace(episode, arrays=bad), spec.seeding)

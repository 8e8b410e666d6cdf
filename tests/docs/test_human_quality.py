"""The script on the quality of human demonstrations plays a recording again, and measures it as it was measured."""

import json

import numpy as np
import pytest
from docs_scripts import load_script

from kitchen_suite.commands import record
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.evaluation.quality import INFOS

pytestmark = pytest.mark.full

# In the layout that kitchen-convert writes. Without noise, the first observation is the start, which is varied.
KWARGS = {
    "tasks_per_episode": [1, 2],
    "quality": True,
    "variations": "start",
    "robot_noise_ratio": 0.0,
    "object_noise_ratio": 0.0,
}


@pytest.fixture
def script():
    return load_script("experiments/human_quality")


@pytest.fixture
def recorded(tmp_path):
    flags = ["--domain_name=kitchen", "--task_name=all", "--policy=expert", "--num_episodes=2"]
    assert record.main([*flags, f"--task_kwargs={json.dumps(KWARGS)}", f"--output={tmp_path / 'expert'}"]) == 0
    return tmp_path / "expert"


def test_actions_that_are_played_again_are_as_clean_as_they_were(script, recorded):
    recording = Recording.open(recorded)
    for episode, measured in zip(recording, script.replays(recording), strict=True):
        infos = {name: episode.arrays[f"info/{name}"][-1] for name in (*INFOS, "is_success")}
        assert measured["success"] == infos["is_success"]
        for name in INFOS:
            np.testing.assert_allclose(measured[name], infos[name], rtol=1e-6, err_msg=name)


def test_the_command_prints_each_measure_with_its_interval(script, recorded, capsys):
    script.main([str(recorded)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split("  ")[0] == "measure"
    assert [line.split()[0] for line in lines[2:]] == ["success", "clean_success", *INFOS]
    successes = sum(bool(episode.arrays["info/is_success"][-1]) for episode in Recording.open(recorded))
    assert float(lines[2].split()[1]) == successes / 2


def test_demonstrations_that_complete_nothing_are_left_out(script, recorded, capsys):
    recording = Recording.open(recorded)
    episodes = [*recording]
    episodes[0].arrays["observation/requested_tasks"][:] = 0
    assert len([*script.replays(episodes)]) == 1
    del episodes[0].arrays["observation/requested_tasks"]
    with pytest.raises(ValueError, match="observation/requested_tasks: make it with kitchen-convert"):
        next(script.replays(episodes))
    for index in recording.indices:
        recording.remove(index)
    with pytest.raises(SystemExit):
        script.main([str(recorded)])
    assert "no episode of the recording completes a task" in capsys.readouterr().err

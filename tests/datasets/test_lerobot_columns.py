"""Episodes as the columns of LeRobot's datasets, without LeRobot; arguments of `kitchen-record --format=lerobot`."""

import dataclasses
import json
import os
import sys

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite.commands.commands import record, replay
from kitchen_suite.datasets.lerobot import (
    DIGEST,
    LeRobotObservations,
    LeRobotPlan,
    dataset_features,
    digest,
    home,
)
from kitchen_suite.episodes.play import SingleRollout
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.settings import EpisodeSettings


@pytest.fixture(scope="module")
def played():
    """The observations of an environment, and an episode of three steps in it."""
    settings = EpisodeSettings(
        task_name="random_2", task_kwargs={"obs_type": "environment_state_agent_pos"}, max_episode_steps=3
    )
    rollout = SingleRollout(EpisodeSpec.of(settings, seeding="gymnasium"))
    episode = rollout.play(0, 7)
    yield LeRobotObservations(suite_env(rollout.environment)), episode
    rollout.environment.close()


def test_columns_have_a_row_for_each_control_step(played):
    observations, episode = played
    columns = observations.columns(episode)
    assert {name: (rows.shape, rows.dtype.name) for name, rows in columns.items()} == {
        "observation.state": ((3, 18), "float32"),
        "observation.environment_state": ((3, 48), "float32"),
        "action": ((3, 9), "float32"),
        "next.reward": ((3,), "float32"),
        "next.done": ((3,), "bool"),
        "next.truncated": ((3,), "bool"),
        "next.success": ((3,), "bool"),
    }
    assert columns.keys() == dataset_features(observations.features).keys()
    # An action stands beside the observation that it was chosen for.
    arrays = episode.arrays
    np.testing.assert_array_equal(columns["observation.state"], arrays["observation/agent_pos"][:3].astype(np.float32))
    np.testing.assert_array_equal(columns["observation.environment_state"][:, 41:].sum(axis=1), [2.0] * 3)
    assert columns["next.done"].tolist() == columns["next.truncated"].tolist() == [False, False, True]


def test_arrays_are_read_back_from_columns(played):
    observations, episode = played
    projected = observations.projected(episode).arrays
    for name, array in projected.items():
        if name != DIGEST:
            rows = episode.arrays[name][1:] if name.startswith("info/") else episode.arrays[name][:3]
            np.testing.assert_array_equal(array, rows.astype(array.dtype), name)
    assert {"observation/agent_pos", "observation/environment_state", "observation/requested_tasks"} < projected.keys()
    assert projected[DIGEST].tobytes().hex() == digest(episode)
    # A dataset holds no labels of actions.
    labelled = dataclasses.replace(episode, arrays={**episode.arrays, "label/is_intervention": np.ones(3, bool)})
    assert digest(labelled) == digest(episode)


def test_the_digest_is_of_all_digits_of_all_arrays_but_pictures(played):
    _, episode = played
    for name, array in episode.arrays.items():
        if array.dtype.kind == "f":
            changed = array.copy()
            changed[-1] = np.nextafter(array[-1], np.inf)
            assert digest(dataclasses.replace(episode, arrays={**episode.arrays, name: changed})) != digest(episode)
    pictures = {"observation/pixels/overview": np.zeros((4, 8, 8, 3), np.uint8)}
    assert digest(dataclasses.replace(episode, arrays={**episode.arrays, **pictures})) == digest(episode)


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["--format=lerobot"], ["'lerobot'", "--dataset=me/"]),
        (["--format=hdf5"], ["hdf5", "minari", "lerobot"]),
        (["--format=lerobot", "--dataset=me/kettle", '--task_kwargs={"obs_type": "goal"}'], ["obs_type", "'goal'"]),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_recorded(arguments, shown, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    error = refusal(record, "--output=runs", *arguments)
    assert all(part in error for part in shown), error
    assert not os.path.exists("runs")


def test_without_lerobot_the_error_names_the_extra(refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("lerobot", "lerobot.datasets", "lerobot.datasets.lerobot_dataset"):
        monkeypatch.setitem(sys.modules, name, None)
    assert "Python 3.12" in refusal(record, "--output=runs", "--format=lerobot", "--dataset=me/kettle")
    assert not os.path.exists("runs")


def test_datasets_are_found_where_lerobot_has_them(monkeypatch, tmp_path, refusal):
    for name in ("HF_LEROBOT_HOME", "HF_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert home() == tmp_path / ".cache/huggingface/lerobot"
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    assert home() == tmp_path / "hf/lerobot"
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "own"))
    assert home() == tmp_path / "own"
    assert home(tmp_path) == tmp_path
    assert "me/nothing" in refusal(replay, "me/nothing")


def test_a_dataset_of_another_program_has_no_seeds(tmp_path, refusal):
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text("{}")
    assert "meta/kitchen_suite.json" in refusal(replay, str(tmp_path))


def test_a_dataset_of_other_episodes_is_not_taken_for_one_of_these(tmp_path, monkeypatch):
    monkeypatch.setattr("kitchen_suite.datasets.lerobot.import_lerobot", lambda: None)
    spec = EpisodeSpec.of(EpisodeSettings(task_name="kettle"), seeding="gymnasium")
    episodes = [{"index": index, "seed": index, "sha256": ""} for index in (0, 2)]
    record = {"recording": spec.as_json(), "num_episodes": 3, "control_frequency": 12.5, "episodes": episodes}
    (tmp_path / "me/set/meta").mkdir(parents=True)
    (tmp_path / "me/set/meta/kitchen_suite.json").write_text(json.dumps(record))
    plan, folder = LeRobotPlan("me/set", spec, 3, tmp_path), RecordingFolder(tmp_path, spec)
    plan.complete(None, folder, [0, 2])
    with refused(FileExistsError, "'me/set'", "other episodes"):
        plan.complete(None, folder, [0, 1, 2])

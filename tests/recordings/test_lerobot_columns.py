"""Episodes as the columns of LeRobot's datasets, without LeRobot; arguments of `kitchen-record --format=lerobot`."""

import dataclasses
import os
import sys

import numpy as np
import pytest

from kitchen_suite.cli.commands import record, replay
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.recordings.lerobot_columns import DIGEST, LeRobotObservations, dataset_features, digest
from kitchen_suite.recordings.lerobot_dataset import home
from kitchen_suite.rollouts.single_rollout import SingleRollout
from kitchen_suite.rollouts.spec import EpisodeSpec
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


def test_the_digest_is_of_all_digits_of_all_arrays_but_pictures(played):
    _, episode = played
    for name, array in episode.arrays.items():
        if array.dtype.kind == "f":
            changed = array.copy()
            changed[-1] = np.nextafter(array[-1], np.inf)
            assert digest(dataclasses.replace(episode, arrays={**episode.arrays, name: changed})) != digest(episode)
    pictures = {"observation/pixels/overview": np.zeros((4, 8, 8, 3), np.uint8)}
    assert digest(dataclasses.replace(episode, arrays={**episode.arrays, **pictures})) == digest(episode)


BAD = {
    "a format without a dataset": (["--format=lerobot"], "format 'lerobot' needs the name of a dataset: --dataset=me/"),
    "also minari": (["--format=minari"], "format 'minari' needs the name of a dataset: --dataset=me/kitchen-v0"),
    "unknown format": (["--format=hdf5", "--dataset=me/kitchen"], "format 'hdf5' does not exist; choose from"),
    "observations that LeRobot does not read": (
        ["--format=lerobot", "--dataset=me/kettle", '--task_kwargs={"obs_type": "goal"}'],
        "LeRobot's obs_type 'goal' does not exist",
    ),
}


@pytest.mark.parametrize(("arguments", "message"), BAD.values(), ids=BAD.keys())
def test_bad_arguments_are_refused_before_anything_is_recorded(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert record.main(["--output=runs", *arguments]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err
    assert not os.path.exists("runs")


def test_without_lerobot_the_error_names_the_extra(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("lerobot", "lerobot.datasets", "lerobot.datasets.lerobot_dataset"):
        monkeypatch.setitem(sys.modules, name, None)
    assert record.main(["--output=runs", "--format=lerobot", "--dataset=me/kettle"]) == 2
    assert "needs LeRobot, which needs Python 3.12" in capsys.readouterr().err
    assert not os.path.exists("runs")


def test_datasets_are_found_where_lerobot_has_them(monkeypatch, tmp_path, capsys):
    for name in ("HF_LEROBOT_HOME", "HF_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert home() == tmp_path / ".cache/huggingface/lerobot"
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    assert home() == tmp_path / "hf/lerobot"
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "own"))
    assert home() == tmp_path / "own"
    assert home(tmp_path) == tmp_path
    assert replay.main(["me/nothing"]) == 2
    error = capsys.readouterr().err
    assert "there is no folder me/nothing, and no Minari or LeRobot dataset of that name" in error


def test_a_dataset_of_another_program_has_no_seeds(tmp_path, capsys):
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text("{}")
    assert replay.main([str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "is no dataset of kitchen-record, which writes the seeds to meta/kitchen_suite.json" in error

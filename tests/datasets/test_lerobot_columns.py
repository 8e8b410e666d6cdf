"""Episodes as the columns of LeRobot's datasets, without LeRobot."""

import dataclasses
import json
import os
import sys
import types

import numpy as np
import pytest
from helpers.episodes import rollout_of

from kitchen_suite.commands import convert, record
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.lerobot.datasets import digest, home, write
from kitchen_suite.lerobot.observations import LeRobotObservations, dataset_features
from kitchen_suite.policies import PolicyRef

SPEC = EnvironmentSpec.make(
    "kitchen", "random_2", {"obs_type": "environment_state_agent_pos"}, max_episode_steps=3
).episodes(PolicyRef.parse("random"), seed=7)


@pytest.fixture(scope="module")
def played():
    """The observations of an environment, and an episode of three steps in it."""
    rollout = rollout_of(SPEC)
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


def test_the_digest_is_not_of_labels(played):
    _, episode = played
    labelled = dataclasses.replace(episode, arrays={**episode.arrays, "label/is_intervention": np.ones(3, bool)})
    assert digest(labelled) == digest(episode)


def test_the_digest_is_of_all_digits_that_are_observed_in_numbers(played):
    _, episode = played
    for name, array in episode.arrays.items():
        if array.dtype.kind == "f" and name != "physics_state":
            changed = array.copy()
            changed[-1] = np.nextafter(array[-1], np.inf)
            assert digest(dataclasses.replace(episode, arrays={**episode.arrays, name: changed})) != digest(episode)
    pictures = {"observation/pixels/overview": np.zeros((4, 8, 8, 3), np.uint8)}
    assert digest(dataclasses.replace(episode, arrays={**episode.arrays, **pictures})) == digest(episode)


@pytest.mark.full
def test_without_lerobot_the_error_names_the_extra(refusal, run, folder, monkeypatch):
    flags = ["--output=runs", "--num_episodes=1", "--max_episode_steps=2", "--obs_type=environment_state_agent_pos"]
    assert run(record, *flags)[0] == 0
    for name in ("lerobot", "lerobot.datasets", "lerobot.datasets.lerobot_dataset"):
        monkeypatch.setitem(sys.modules, name, None)
    arguments = ["runs", "--format=lerobot", "--dataset=me/kettle"]
    assert "Python 3.12" in refusal(convert, *arguments, "--data_path=data")
    assert not os.path.exists("data")


def test_datasets_are_where_lerobot_has_them(monkeypatch, tmp_path):
    for name in ("HF_LEROBOT_HOME", "HF_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert home() == tmp_path / ".cache/huggingface/lerobot"
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    assert home() == tmp_path / "hf/lerobot"
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "own"))
    assert home() == tmp_path / "own"
    assert home(tmp_path) == tmp_path


class StandIn:
    """Keeps what LeRobot's class is called with."""

    made: list["StandIn"] = []

    def __init__(self, dataset_id, fps, root):
        self.id, self.fps = dataset_id, fps
        self.frames, self.lengths = [], []
        self.is_finalized = False
        root.mkdir()
        (root / "meta").mkdir()

    @classmethod
    def create(cls, dataset_id, fps, features, *, root, **options):
        cls.made.append(cls(dataset_id, fps, root))
        return cls.made[-1]

    def add_frame(self, frame):
        self.frames.append(frame)

    def save_episode(self):
        self.lengths.append(len(self.frames) - sum(self.lengths))

    def finalize(self):
        self.is_finalized = True


@pytest.mark.full
def test_every_episode_is_given_to_lerobot(played, tmp_path, monkeypatch):
    observations, episode = played
    library, datasets = types.SimpleNamespace(LeRobotDataset=StandIn), types.ModuleType("datasets")
    for name in ("is_progress_bar_enabled", "disable_progress_bars", "enable_progress_bars"):
        setattr(datasets, name, lambda: False)
    monkeypatch.setitem(sys.modules, "datasets", datasets)
    monkeypatch.setattr("kitchen_suite.lerobot.datasets.import_lerobot", lambda: library)
    episodes = [dataclasses.replace(episode, index=index, seed=7 + index) for index in (0, 2)]
    write(tmp_path / "me" / "set", SPEC, episodes)
    dataset = StandIn.made.pop()
    assert (dataset.id, dataset.fps, dataset.lengths, dataset.is_finalized) == ("me/set", 12, [3, 3], True)
    assert {frame.pop("task") for frame in dataset.frames} == {episode.instruction}
    for name, rows in observations.columns(episode).items():
        found = np.array([frame[name] for frame in dataset.frames])
        np.testing.assert_array_equal(found.reshape(2, *rows.shape), np.stack([rows, rows]), name)
    record = json.loads((tmp_path / "me/set/meta/kitchen_suite.json").read_text())
    assert record == {
        "recording": SPEC.as_json(),
        "num_episodes": 3,
        "control_frequency": 12.5,
        "episodes": [{"index": each.index, "seed": each.seed, "sha256": digest(episode)} for each in episodes],
    }
    with pytest.raises(OSError, match="me/set"):
        write(tmp_path / "me" / "set", SPEC, episodes)

"""`kitchen-convert`: data of other programs, made up here in their layouts, become recordings to learn from."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from human_files import ELEMENTS, EPISODES, LENGTH, actions, positions, write_d4rl, write_minari

from kitchen_suite.cli.commands import convert, record, replay
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.tasks import GOALS

pytestmark = pytest.mark.filterwarnings("ignore:env_spec is None", "ignore:`\\w+` is set to None")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    (tmp_path / "datasets").mkdir()
    return tmp_path


def recorded(folder="human"):
    recording = RecordingFolder.open(Path(folder))
    return [recording.load(index) for index in recording.indices], [
        recording.load_stats(index) for index in recording.indices
    ]


def check_recording(episodes, statistics, *, velocities):
    for completions, episode, stats in zip(EPISODES, episodes, statistics, strict=True):
        made, arrays = positions(completions), episode.arrays
        assert episode.steps == LENGTH
        assert episode.seed is None
        assert stats.metrics == {
            "success": bool(completions),
            "tasks_completed": dict(sorted(completions.items(), key=lambda item: item[1])),
        }
        state = arrays["observation/observation"]
        np.testing.assert_allclose(state[:, :9], made[:, :9], rtol=1e-6)
        np.testing.assert_allclose(state[:, 18:39], made[:, 9:], rtol=1e-6)
        hidden = np.concatenate([state[:, 9:18], state[:, 39:]], axis=1)
        assert (np.isfinite(hidden) if velocities else np.isnan(hidden)).all()
        np.testing.assert_array_equal(arrays["action"], actions(LENGTH + (not velocities))[:LENGTH])
        tasks = [*GOALS][:7]
        np.testing.assert_array_equal(
            arrays["observation/requested_tasks"], np.tile([task in completions for task in tasks], (LENGTH + 1, 1))
        )
        by_step = [sum(step == wanted for wanted in completions.values()) for step in range(1, LENGTH + 1)]
        np.testing.assert_array_equal(arrays["reward"], by_step)
        assert arrays["truncation"].tolist() == [False] * (LENGTH - 1) + [True]
        assert not arrays["termination"].any()
        np.testing.assert_allclose(
            arrays["observation/achieved_goal/kettle"], made[:, ELEMENTS["kettle"]], rtol=1e-6, atol=1e-7
        )
    assert episodes[0].instruction.startswith("open the microwave door, then move the kettle")
    assert episodes[2].instruction == ""


@pytest.mark.parametrize("timeouts", [False, True])
def test_a_file_of_d4rl_becomes_a_recording(timeouts, folder, capsys):
    write_d4rl("kitchen_complete-v0.hdf5", timeouts=timeouts)
    assert convert.main(["kitchen_complete-v0.hdf5", "--output=human"]) == 0
    printed = capsys.readouterr().out
    assert "4 episodes of kitchen_complete-v0.hdf5 (D4RL), 40 control steps" in printed
    assert "goals of the data: kettle, light switch, microwave, slide cabinet" in printed
    assert re.search(r"^hinge cabinet +1$", printed, re.MULTILINE)
    assert "velocities were not recorded" in printed
    check_recording(*recorded(), velocities=False)


@pytest.mark.parametrize("name", ["D4RL/kitchen/complete-v2", "datasets/D4RL/kitchen/complete-v2"])
def test_a_minari_dataset_becomes_a_recording(name, folder, capsys):
    write_minari()
    assert convert.main([name, "--output=human"]) == 0
    printed = capsys.readouterr().out
    assert f"4 episodes of {name} (Minari), 40 control steps" in printed
    assert "velocities" not in printed
    check_recording(*recorded(), velocities=True)


def test_arrays_are_those_of_a_recording_of_the_suite(folder):
    write_d4rl("a.hdf5")
    assert convert.main(["a.hdf5", "--output=human"]) == 0
    specification = json.loads((folder / "human" / "recording.json").read_text())
    assert specification["origin"] == {"format": "D4RL", "source": "a.hdf5"}
    arguments = ["--output=own", "--num_episodes=1", f"--max_episode_steps={LENGTH}", "--task_name=all"]
    assert record.main([*arguments, f"--task_kwargs={json.dumps(specification['task_kwargs'])}"]) == 0
    (converted, *_), (own, *_) = recorded()[0], recorded("own")[0]
    assert {name: (array.shape, array.dtype) for name, array in own.arrays.items()} == {
        name: (array.shape, array.dtype) for name, array in converted.arrays.items()
    }


def test_the_same_command_continues_and_other_recordings_are_kept(folder, capsys):
    write_d4rl("a.hdf5")
    write_d4rl("b.hdf5")
    for _ in range(2):
        assert convert.main(["a.hdf5", "--output=human"]) == 0
    check_recording(*recorded(), velocities=False)
    capsys.readouterr()
    assert convert.main(["b.hdf5", "--output=human"]) == 2
    assert "human holds a recording with origin" in capsys.readouterr().err
    assert replay.main(["human"]) == 2
    assert "was made by kitchen-convert" in capsys.readouterr().err


def rows(count=44):
    return np.zeros((count, 60), np.float32)


BAD = {
    "59 numbers": ({"observations": rows()[:, :59]}, "observations of a.hdf5 have shape (44, 59), not (44, 60)"),
    "other actions": ({"actions": np.zeros((44, 8))}, "actions of a.hdf5 have shape (44, 8), not (44, 9)"),
    "fewer actions": ({"actions": np.zeros((43, 9))}, "actions of a.hdf5 have shape (43, 9), not (44, 9)"),
    "positions as actions": ({"actions": np.full((44, 9), 1.9)}, "reach 1.9: they are no joint velocities in [-1, 1]"),
    "NaN": ({"observations": rows() * np.nan}, "observations of a.hdf5 are not all finite"),
    "no terminals": ({"terminals": None}, "a.hdf5 has no array 'terminals'"),
    "terminals": ({"terminals": np.zeros((44, 1))}, "terminals of a.hdf5 have shape (44, 1), not (44,)"),
    "one row each": ({"terminals": np.ones(44)}, "a.hdf5 holds no episodes of two or more observations"),
}


@pytest.mark.parametrize("case", BAD)
def test_files_of_another_layout_are_refused_in_one_line(case, folder, capsys):
    changes, message = BAD[case]
    write_d4rl("a.hdf5", **changes)
    assert convert.main(["a.hdf5", "--output=human"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert not (folder / "human").exists()


def test_other_sources_are_refused_in_one_line(folder, capsys):
    (folder / "damaged.hdf5").write_text("no HDF5")
    write_minari("kitchen/short-v0", size=30)
    write_minari("kitchen/own-v0", env_id="KitchenSuite/FrankaKitchen-v1")
    assert record.main(["--output=own", "--num_episodes=1", "--max_episode_steps=2"]) == 0
    messages = {
        "nothing.hdf5": "no such file: 'nothing.hdf5'",
        "damaged.hdf5": "damaged.hdf5 does not hold HDF5",
        "nowhere": "there is no folder nowhere",
        "own": "own is a recording of this suite already",
        "kitchen/own-v0": "is not of FrankaKitchen-v1, but of this suite",
        "kitchen/short-v0": "have shape (11, 30), not (11, 59)",
    }
    capsys.readouterr()
    for source, message in messages.items():
        assert convert.main([source, "--output=human"]) == 2
        assert message in capsys.readouterr().err

"""`kitchen-convert`: data of other programs, made up here in their layouts, become recordings to learn from."""

import hashlib
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers.human_files import ELEMENTS, EPISODES, LENGTH, actions, positions, write_d4rl, write_minari

from kitchen_suite.commands import convert, record, replay
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.tasks import GOALS

pytestmark = pytest.mark.filterwarnings("ignore:env_spec is None", "ignore:`\\w+` is set to None")


@pytest.fixture
def folder(folder):
    (folder / "datasets").mkdir()
    return folder


def recorded(folder="human"):
    recording = Recording.open(Path(folder))
    return [recording.load(index) for index in recording.indices], [
        recording.load_summary(index) for index in recording.indices
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


@pytest.mark.full
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


@pytest.mark.full
@pytest.mark.parametrize("name", ["D4RL/kitchen/complete-v2", "datasets/D4RL/kitchen/complete-v2"])
def test_a_minari_dataset_becomes_a_recording(name, folder, capsys):
    write_minari()
    assert convert.main([name, "--output=human"]) == 0
    printed = capsys.readouterr().out
    assert f"4 episodes of {name} (Minari), 40 control steps" in printed
    assert "velocities" not in printed
    specification = json.loads((folder / "human" / "recording.json").read_text())
    assert len(specification["origin"].pop("sha256")) == 64
    assert specification["origin"] == {"format": "Minari", "source": name, "episodes": 4, "steps": 40}
    check_recording(*recorded(), velocities=True)


@pytest.mark.full
def test_arrays_are_those_of_a_recording_of_the_suite(folder):
    write_d4rl("a.hdf5")
    assert convert.main(["a.hdf5", "--output=human"]) == 0
    specification = json.loads((folder / "human" / "recording.json").read_text())
    assert specification["origin"] == {
        "format": "D4RL",
        "source": "a.hdf5",
        "sha256": hashlib.sha256((folder / "a.hdf5").read_bytes()).hexdigest(),
    }
    arguments = ["--output=own", "--num_episodes=1", f"--max_episode_steps={LENGTH}", "--task_name=all"]
    assert record.main([*arguments, f"--task_kwargs={json.dumps(specification['task_kwargs'])}"]) == 0
    (converted, *_), (own, *_) = recorded()[0], recorded("own")[0]
    layouts = [{name: (array.shape, array.dtype) for name, array in each.arrays.items()} for each in (own, converted)]
    # Demonstrations of people have no state of the physics.
    assert layouts[0].pop("physics_state") == ((LENGTH + 1, 59), np.float64)
    assert layouts[0] == layouts[1]


@pytest.mark.full
def test_the_same_command_continues_and_other_recordings_are_kept(folder, refusal):
    write_d4rl("a.hdf5")
    write_d4rl("b.hdf5")
    for _ in range(2):
        assert convert.main(["a.hdf5", "--output=human"]) == 0
    check_recording(*recorded(), velocities=False)
    assert "origin" in refusal(convert, "b.hdf5", "--output=human")
    write_d4rl("a.hdf5", timeouts=True)
    assert "sha256" in refusal(convert, "a.hdf5", "--output=human")
    assert "human holds episodes of another program, without seeds to replay from" in refusal(replay, "human")


def rows(count=44):
    return np.zeros((count, 60), np.float32)


# Changes of the arrays of a file, and the shapes, names or numbers that the error shows.
BAD = {
    "another state": ({"observations": rows()[:, :59]}, ["observations", "(44, 59)", "(44, 60)"]),
    "fewer actions": ({"actions": np.zeros((43, 9))}, ["actions", "(43, 9)", "(44, 9)"]),
    "positions as actions": ({"actions": np.full((44, 9), 1.9)}, ["1.9", "[-1, 1]"]),
    "NaN": ({"observations": rows() * np.nan}, ["observations", "finite"]),
    "no terminals": ({"terminals": None}, ["'terminals'"]),
    "a number": ({"observations": np.float32(1)}, ["observations", "()", "(1, 60)"]),
    "a null dataspace": ({"observations": h5py.Empty("f4")}, ["'observations'"]),
    "one row each": ({"terminals": np.ones(44)}, ["no episodes"]),
}


@pytest.mark.full
@pytest.mark.parametrize("case", BAD)
def test_files_of_another_layout_are_refused_in_one_line(case, folder, refusal):
    changes, shown = BAD[case]
    write_d4rl("a.hdf5", **changes)
    error = refusal(convert, "a.hdf5", "--output=human")
    assert all(part in error for part in ["a.hdf5", *shown]), error
    assert not (folder / "human").exists()


@pytest.mark.full
def test_other_sources_are_refused_in_one_line(folder, refusal):
    (folder / "damaged.hdf5").write_text("no HDF5")
    write_minari("kitchen/short-v0", size=30)
    write_minari("kitchen/own-v0", env_id="KitchenSuite/FrankaKitchen-v1")
    assert record.main(["--output=own", "--num_episodes=1", "--max_episode_steps=2"]) == 0
    assert "damaged.hdf5" in refusal(convert, "damaged.hdf5", "--output=human", status=1)
    for source in ("nothing.hdf5", "nowhere", "own", "kitchen/own-v0", "kitchen/short-v0"):
        assert source in refusal(convert, source, "--output=human")

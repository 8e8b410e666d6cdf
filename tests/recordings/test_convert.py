"""`kitchen-convert`: data of other programs, made up here in their layouts, become recordings to learn from."""

import json
import re
from pathlib import Path

import h5py
import minari
import numpy as np
import pytest
from gymnasium import spaces

from kitchen_suite.cli import convert, record, replay
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.initial_state import INITIAL_QPOS

# As D4RL has them: indices of the positions of a task's joints among the first 30 numbers of an observation.
ELEMENTS = {
    "bottom burner": [11, 12],
    "top burner": [15, 16],
    "light switch": [17, 18],
    "slide cabinet": [19],
    "hinge cabinet": [20, 21],
    "microwave": [22],
    "kettle": [23, 24, 25, 26, 27, 28, 29],
}
WANTED = ("microwave", "kettle", "light switch", "slide cabinet")

# Tasks that the made-up episodes complete, and the step after which each is complete.
EPISODES = (
    {"kettle": 3, "microwave": 1, "light switch": 5, "slide cabinet": 9},
    {"hinge cabinet": 2, "bottom burner": 4},
    {},
    {"top burner": 8},
)
LENGTH = 10


def positions(completions, length=LENGTH):
    """Returns the 30 positions `(length + 1, 30)` of an episode that completes tasks after given steps."""
    made = np.tile(INITIAL_QPOS, (length + 1, 1))
    made[:, :9] += 0.01 * np.arange(length + 1)[:, np.newaxis]
    for task, step in completions.items():
        made[step:, ELEMENTS[task]] = GOALS[task].value
    return made


def actions(length=LENGTH):
    return np.random.default_rng(length).uniform(-0.999, 0.999, (length, 9)).astype(np.float32)


def write_d4rl(path, episodes=EPISODES, timeouts=False, **changes):
    """Writes a file in the layout of D4RL's kitchen: no observation follows the last action of an episode."""
    goal = np.zeros(30)
    for task in WANTED:
        goal[ELEMENTS[task]] = GOALS[task].value
    rows = [np.column_stack([made, np.tile(goal, (len(made), 1))]) for made in map(positions, episodes)]
    ends = np.concatenate([np.arange(len(each)) == len(each) - 1 for each in rows]).astype(np.float32)
    arrays = {
        "observations": np.concatenate(rows).astype(np.float32),
        "actions": np.concatenate([actions(len(each)) for each in rows]),
        "rewards": np.zeros(ends.size, np.float32),
        "terminals": np.zeros_like(ends) if timeouts else ends,
        "infos": np.zeros(ends.size, np.int64),
        **({"timeouts": ends} if timeouts else {}),
    }
    with h5py.File(path, "w") as file:
        for name, array in {**arrays, **changes}.items():
            if array is not None:
                file[name] = array


class Original:
    """Stands for gymnasium-robotics' environment, which fails on this MuJoCo."""


def write_minari(root, name="D4RL/kitchen/complete-v2", env_id="FrankaKitchen-v1", size=59):
    """Writes a Minari dataset in the layout of D4RL/kitchen/complete-v2."""
    from gymnasium.envs.registration import EnvSpec

    goal = {task: spaces.Box(-np.inf, np.inf, (len(GOALS[task].value),), np.float64) for task in WANTED}
    observed = {"observation": spaces.Box(-np.inf, np.inf, (size,), np.float64)}
    buffers = []
    for completions in EPISODES:
        made = positions(completions)
        state = np.zeros((LENGTH + 1, 59))
        state[:, :9], state[:, 18:39] = made[:, :9], made[:, 9:]
        achieved = {task: made[:, ELEMENTS[task]] for task in WANTED}
        desired = {task: np.tile(GOALS[task].value, (LENGTH + 1, 1)) for task in WANTED}
        flags = np.zeros(LENGTH, bool)
        buffers.append(
            minari.data_collector.EpisodeBuffer(
                observations={"achieved_goal": achieved, "desired_goal": desired, "observation": state[:, :size]},
                actions=actions().astype(np.float64),
                rewards=np.zeros(LENGTH),
                terminations=flags,
                truncations=np.arange(LENGTH) == LENGTH - 1,
                infos={"ctrl": np.zeros((LENGTH + 1, 9))},
            )
        )
    arguments = {
        "remove_task_when_completed": False,
        "terminate_on_tasks_completed": False,
        "tasks_to_complete": [*WANTED],
    }
    specification = EnvSpec(
        id=env_id,
        entry_point="gymnasium_robotics.envs:KitchenEnv",
        max_episode_steps=280,
        kwargs=arguments,
    )
    minari.create_dataset_from_buffers(
        name,
        buffers,
        env=specification,
        observation_space=spaces.Dict(
            {"achieved_goal": spaces.Dict(goal), "desired_goal": spaces.Dict(goal), **observed}
        ),
        action_space=spaces.Box(-1.0, 1.0, (9,), np.float64),
    )


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
    write_minari(folder)
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
    assert "human holds another recording" in capsys.readouterr().err
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
    write_minari(folder, "kitchen/short-v0", size=30)
    write_minari(folder, "kitchen/own-v0", env_id="KitchenSuite/FrankaKitchen-v1")
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

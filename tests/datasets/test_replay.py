"""`kitchen-replay` from the command line: equal replays, and differences."""

import contextlib
import functools
import json
import re
import shutil
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.sweeps import brief, brief_named

from kitchen_suite.commands import record, replay, rollout
from kitchen_suite.episodes.replay import choose
from kitchen_suite.versions import installed_versions

pytestmark = pytest.mark.full

KITCHEN = ["--num_threads=1", "--num_envs=4", "--max_episode_steps=6"]
# The microwave's goal lies within its threshold from the start, the kettle's does not.
EASY = '--task_kwargs={"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [-0.2]}}'
COLUMNS = ["episode", "seed", "steps", "return", "replayed", "difference", "rewards", "end", "completions"]
EQUAL = {"difference": "0", "rewards": "equal", "end": "equal", "completions": "equal"}


@pytest.fixture
def run(run, folder):
    """Runs the command in an empty folder; returns status, stdout and stderr."""
    return functools.partial(run, replay)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with a recording of four episodes."""
    folder = tmp_path_factory.mktemp("recorded")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert record.main([*KITCHEN, "--output=runs", "--num_episodes=4", EASY]) == 0
    return folder


@pytest.fixture
def runs(run, recorded, tmp_path):
    """A copy of the recording, which a test may change."""
    shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)


def rows(out):
    """Cells of the table, by column."""
    names, *values = (re.split(r"\s{2,}", line.strip()) for line in out.split("\n\n")[-2].splitlines())
    assert names == COLUMNS
    return [dict(zip(names, row, strict=True)) for row in values]


def change(index, **changes):
    """Rewrites an array of a recorded episode; a change is a function of the array."""
    path = f"runs/episode_{index:06d}.npz"
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    for name, function in changes.items():
        function(arrays[name.replace("__", "/")])
    np.savez_compressed(path, **arrays)


def without_digest(index):
    """Makes a recorded episode one of an earlier version, which has no digest of the actions."""
    path = f"runs/episode_{index:06d}.npz"
    metadata, arrays = load_episode(path)
    del metadata["actions_sha256"]
    np.savez_compressed(path, **arrays, metadata=json.dumps(metadata))


def respecify(folder, **changes):
    """Changes attributes of a recording's specification, in its file and in those of its episodes."""
    path = Path(folder, "recording.json")
    spec = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps(spec))
    for episode in path.parent.glob("episode_*.npz"):
        metadata, arrays = load_episode(episode)
        np.savez_compressed(episode, **arrays, metadata=json.dumps({**metadata, "recording": spec}))


def test_a_recording_replays_exactly(run, runs):
    status, out, err = run("runs")
    assert (status, err) == (0, "")
    assert out.startswith("runs: 4 of 4 episodes\n\n")
    assert max(map(len, out.splitlines())) <= 100
    numbers = [{"episode": str(i), "seed": str(i), "steps": "6", "return": "1", "replayed": "1"} for i in range(4)]
    assert rows(out) == [{**row, **EQUAL} for row in numbers]
    assert out.endswith("\n4 of 4 episodes are equal\n")


def test_cabinets_replay_exactly_however_long_the_environment_has_lived(run, capsys, monkeypatch):
    monkeypatch.setattr("kitchen_suite.tasks.open_cabinet.rewards.LATE_STAGE", 10)
    command = ["--output=runs", "--domain_name=open_cabinet", "--num_envs=2", "--num_episodes=5"]
    assert record.main(["--num_threads=1", *command]) == 0
    capsys.readouterr()
    status, out, _ = run("runs")
    assert (status, len(rows(out))) == (0, 5)
    assert all(row["difference"] == "0" for row in rows(out))


@pytest.mark.parametrize("obs_type", ["goal", "state", "environment_state_agent_pos"])
def test_kitchens_with_extra_observables_replay_exactly(run, capsys, obs_type):
    kwargs = {"obs_type": obs_type, "extra_observables": ["kettle/pose", "franka/gripper_width"]}
    command = [*KITCHEN, "--output=runs", "--num_episodes=2", f"--task_kwargs={json.dumps(kwargs)}"]
    assert record.main(command) == 0
    capsys.readouterr()
    status, out, err = run("runs")
    assert (status, err) == (0, "")
    assert out.endswith("\n2 of 2 episodes are equal\n")


ROLLOUTS = {
    "kitchen": [EASY, "--task_name=all", "--policy=random", "--max_episode_steps=6"],
    "kitchen, float64 feedback": ['--task_kwargs={"feedback": "true", "goal_format": "flat"}', "--max_episode_steps=6"],
    "open_cabinet": ["--domain_name=open_cabinet", "--task_name=bottom_drawer", "--max_episode_steps=40"],
    "open_cabinet, options": [
        "--domain_name=open_cabinet",
        "--max_episode_steps=40",
        '--task_kwargs={"action_limit": 0.3, "observation_noise": {"drawer_position": 0.01}, "reward": "grasp"}',
    ],
    "kitchens": ["--domain_name=kitchens", "--task_name=any_2", "--policy=random", "--max_episode_steps=6"],
    "objects": ["--domain_name=pick_and_place", "--task_name=any_2", "--policy=random", "--max_episode_steps=6"],
}


@pytest.mark.parametrize(
    "arguments", brief_named(ROLLOUTS, kept=["kitchen, float64 feedback", "open_cabinet, options"])
)
def test_a_folder_of_rollouts_replays_exactly(run, capsys, monkeypatch, arguments):
    # The second episode of an environment would begin with the greater penalties.
    monkeypatch.setattr("kitchen_suite.tasks.open_cabinet.rewards.LATE_STAGE", 10)
    # More than 32 bits, as neither way of seeding may cut them off.
    assert rollout.main([*arguments, "--output=rolled", "--num_episodes=3", f"--seed={2**32 + 7}"]) == 0
    capsys.readouterr()
    status, out, err = run("rolled")
    assert (status, err) == (0, "")
    assert out.startswith("rolled: 3 of 3 episodes\n\n")
    assert [row["seed"] for row in rows(out)] == [str(2**32 + 7 + i) for i in range(3)]
    for row in rows(out):
        assert row == {**row, **EQUAL, "replayed": row["return"]}
    assert out.endswith("\n3 of 3 episodes are equal\n")
    # The same seeds start other episodes where Gymnasium draws from them.
    respecify("rolled", seeding="gymnasium")
    status, out, _ = run("rolled")
    scores_stand = all(row[name] == "equal" for row in rows(out) for name in ("rewards", "end", "completions"))
    assert status == (3 if scores_stand else 1)
    assert all(float(row["difference"]) > 0 for row in rows(out))


def let_go(array):
    array[2] = -array[2]


def test_every_change_is_found(run, runs):
    def add(step):
        def function(array):
            array[step] += 1

        return function

    change(0, reward=add(3))
    change(1, action=let_go)
    without_digest(1)
    change(2, observation__observation=add((4, 50)))
    change(3, termination=add(1))
    status, out, _ = run("runs")
    reward, action, observation, termination = rows(out)
    assert status == 1
    assert reward == {**reward, **EQUAL, "return": "2", "rewards": "differ at 4"}
    assert action == {**action, **EQUAL, "difference": action["difference"]}
    assert float(action["difference"]) > 1e-3
    assert observation == {**observation, **EQUAL, "difference": "1"}
    assert termination == {**termination, **EQUAL, "end": "differ at 2"}
    assert out.endswith("\n0 of 4 episodes are equal\n")


def open_further(array):
    """Changes the last action where it is clipped: a finger of the last episode is open as far as it goes."""
    assert 0.0 < array[-1, -1] < 1.0
    array[-1, -1] = 1.0


def test_an_action_changed_without_effect_is_named(run, runs):
    change(3, action=open_further)
    status, _, err = run("runs")
    assert status == 1
    assert re.fullmatch(r"kitchen-replay: runs/episode_000003.npz [^\n]* actions [^\n]*\n", err)
    without_digest(3)
    assert run("runs")[0] == 0


def test_a_completion_that_differs_is_named(run, runs):
    def shut(array):
        array[3:] = 0.2

    change(2, observation__achieved_goal__microwave=shut)
    status, out, _ = run("runs", "--episodes=1-2")
    assert status == 1
    assert [row["completions"] for row in rows(out)] == ["equal", "differ at 3: microwave"]
    assert out.endswith("\n1 of 2 episodes are equal\n")


def set_nan(array):
    array[0, 0] = np.nan


@pytest.mark.parametrize(
    "name", brief(["achieved_goal/kettle", "desired_goal/microwave", "observation"], kept=["achieved_goal/kettle"])
)
def test_nan_in_an_observation_is_a_difference(run, runs, name):
    change(1, **{f"observation/{name}": set_nan})
    status, out, _ = run("runs", "--episodes=1")
    assert (status, rows(out)[0]["difference"]) == (3, "nan")
    assert out.endswith("\n0 of 1 episodes are equal\n")


def test_a_missing_observation_is_a_difference(run, runs):
    metadata, arrays = load_episode("runs/episode_000001.npz")
    del arrays["observation/desired_goal/kettle"]
    np.savez_compressed("runs/episode_000001.npz", **arrays, metadata=json.dumps(metadata))
    status, out, _ = run("runs", "--episodes=0,1")
    assert (status, [row["difference"] for row in rows(out)]) == (3, ["0", "inf"])
    assert out.endswith("\n1 of 2 episodes are equal\n")


@pytest.mark.parametrize(
    "name",
    brief(
        ["reward", "termination", "observation/achieved_goal/kettle", "info/completion_steps"],
        kept=["reward", "observation/achieved_goal/kettle"],
    ),
)
def test_an_array_of_fewer_steps_is_refused(run, runs, name):
    metadata, arrays = load_episode("runs/episode_000001.npz")
    np.savez_compressed("runs/episode_000001.npz", **{**arrays, name: arrays[name][:1]}, metadata=json.dumps(metadata))
    status, _, err = run("runs", "--episodes=1")
    assert status == 1
    assert re.fullmatch(r"kitchen-replay: runs/episode_000001.npz does not hold an episode: .* does not fit .*\n", err)


def test_an_info_that_differs_is_a_difference_and_named(run, runs):
    def later(array):
        array[:] = 5

    change(1, **{"info/completion_steps": later})
    status, out, _ = run("runs", "--episodes=0,1")
    assert (status, len(rows(out))) == (3, 2)
    assert out.endswith("\n\nepisode 1 differs in info/completion_steps\n1 of 2 episodes are equal\n")


def test_other_versions_are_printed(run, runs):
    respecify("runs", versions={**installed_versions(), "mujoco": "3.0.0"})
    status, out, _ = run("runs")
    assert status == 0
    assert re.match(r"runs: 4 of 4 episodes\nrecorded with mujoco 3.0.0, here [\d.]+\n\n", out)


@pytest.mark.parametrize(
    ("wanted", "count", "chosen"),
    [
        (None, 10, [0, 1, 3, 5, 6]),
        (None, 2, [0, 6]),
        (None, 3, [0, 3, 6]),
        (None, 1, [0]),
        ("all", 1, [0, 1, 3, 5, 6]),
        ("5", 10, [5]),
        ("3,0-1", 10, [3, 0, 1]),
    ],
)
def test_episodes_are_chosen_by_number_or_spread_from_first_to_last(wanted, count, chosen):
    assert choose([0, 1, 3, 5, 6], wanted, count) == chosen


@pytest.mark.nightly
@pytest.mark.rendering
def test_a_video_shows_every_time_step_of_the_replay(run, runs):
    size = ("--width=96", "--height=70")
    status, out, _ = run("runs", "--num_episodes=2", "--video=film.mp4", "--video_episodes=2", *size)
    assert (status, len(rows(out))) == (0, 2)
    with contextlib.closing(imageio.get_reader("film.mp4")) as reader:
        frames = np.stack(list(reader.iter_data()))
        assert reader.get_meta_data()["fps"] == 12.5
    assert frames.shape == (2 * (6 + 1), 70, 96, 3)
    assert (frames.std(axis=(1, 2, 3)) > 20).all()


BAD = {
    "": ["recording is missing"],
    "nowhere": ["nowhere"],
    "empty": ["empty", "recording.json"],
    "runs/episode_000000.npz": ["runs"],
    "runs --episodes=some": ["episodes", "'all'"],
    "runs --episodes=3-1": ["3-1"],
    "runs --episodes=0-99999999999": ["99999999999"],
    "runs --episodes=4": ["episode 4"],
    "runs --task_name=kettle": ["--task_name"],
    "runs --width=33": ["even"],
    "runs --camera=overvew": ["'overview'"],
}


def test_a_bad_argument_gets_one_line_and_status_2(run, runs, tmp_path):
    tmp_path.joinpath("empty").mkdir()
    for arguments, shown in BAD.items():
        status, out, err = run(*arguments.split())
        assert (status, out) == (2, ""), arguments
        assert re.fullmatch(r"kitchen-replay: [^\n]+\n", err)
        assert all(part in err for part in shown), err


def test_a_description_of_another_layout_gets_one_line(run, tmp_path):
    tmp_path.joinpath("broken").mkdir()
    tmp_path.joinpath("broken", "recording.json").write_text(json.dumps({"seed": 3}))
    status, out, err = run("broken")
    assert (status, out) == (1, "")
    assert re.fullmatch(r"kitchen-replay: broken/recording.json does not describe a recording: [^\n]+\n", err)


def test_positions_beyond_what_mujoco_simulates_are_a_difference_without_numpys_warning(run, runs):
    change(1, observation__observation=lambda array: array[0].fill(1e300))
    status, out, err = run("runs", "--episodes=1")
    assert (status, err) == (3, "")
    assert rows(out)[0]["difference"] == "1e+300"


def test_a_file_that_is_no_episode_gets_one_line(run, runs, tmp_path):
    tmp_path.joinpath("runs", "episode_000001.npz").write_bytes(b"nothing")
    status, _, err = run("runs")
    assert (status, err.count("\n")) == (1, 1)
    assert "runs/episode_000001.npz does not hold an episode" in err

"""Recordings in the files of other programs: every number survives, and their own loaders read them."""

import dataclasses
import functools
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from helpers.episodes import limited_files, load_episode
from helpers.errors import refused

from kitchen_suite.commands.commands import convert, record
from kitchen_suite.datasets.bet_folder import as_torch_file
from kitchen_suite.datasets.formats import FORMATS
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.names import DEFAULT_TASKS
from kitchen_suite.settings import EpisodeSettings

COUNT = 3
pytestmark = pytest.mark.thorough

KITCHEN = ["--num_threads=1", "--output=runs", f"--num_episodes={COUNT}", "--num_envs=2", "--seed=5"]
EXPERT = ["--policy=expert", "--task_name=complete", '--task_kwargs={"variations": null}']
SHORT = ["--policy=random", "--task_name=kettle", "--max_episode_steps=5"]
CABINET = ["--domain_name=open_cabinet", "--max_episode_steps=5"]
PICTURES = ['--task_kwargs={"obs_type": "pixels_agent_pos", "image_size": [16, 20], "render_quality": "fast"}']
NAMES = ("robomimic", "ogbench", "d4rl", "diffusion_policy", "bet")


@pytest.fixture
def make(run, folder):
    """Records episodes in a format, in an empty folder; returns status, stdout and stderr."""

    def make(name, *arguments):
        return run(record, *KITCHEN, f"--format={name}", "--dataset=me/set", "--data_path=data", *arguments)

    return make


def recorded(index):
    return load_episode(f"runs/episode_{index:06d}.npz")[1]


def states(arrays):
    return arrays["observation/observation"] if "observation/observation" in arrays else arrays["observation"]


@pytest.mark.parametrize("arguments", [EXPERT, CABINET], ids=["kitchen", "cabinet"])
def test_d4rl(make, run, arguments):
    import h5py

    status, out, err = make("d4rl", *arguments)
    assert (status, err) == (0, "")
    assert "dataset me/set in data/me/set.hdf5" in out
    with h5py.File("data/me/set.hdf5") as file:
        rows = {name: file[name][:] for name in file if name != "infos"}
        state = file["infos/observations"][:] if "infos" in file else rows["observations"]
    ends = np.flatnonzero(rows["terminals"] | rows["timeouts"]) + 1
    assert len(ends) == COUNT
    for index, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        arrays = recorded(index)
        np.testing.assert_array_equal(state[start:end], states(arrays)[:-1])
        np.testing.assert_array_equal(rows["actions"][start:end], arrays["action"])
        np.testing.assert_array_equal(rows["rewards"][start:end], arrays["reward"])
        np.testing.assert_array_equal(rows["terminals"][start:end], arrays["termination"])
        np.testing.assert_array_equal(rows["next_observations"][start : end - 1], rows["observations"][start + 1 : end])
    if arguments is EXPERT:
        assert rows["observations"].shape[1] == 60
        # As D4RL's own files, which have no record beside them, so that what reads those reads this one.
        os.remove("data/me/set.hdf5.kitchen_suite.json")
        status, out, err = run(convert, "data/me/set.hdf5", "--output=back")
        assert (status, err) == (0, ""), err
        _, back = load_episode("back/episode_000000.npz")
        for name, rows in recorded(0).items():
            if name.startswith("observation/desired_goal"):
                np.testing.assert_allclose(back[name][0], rows[0])


@pytest.mark.parametrize("arguments", [EXPERT, CABINET], ids=["kitchen", "cabinet"])
def test_ogbench(make, arguments):
    status, _, err = make("ogbench", *arguments)
    assert (status, err) == (0, "")
    with np.load("data/me/set.npz") as file:
        rows = dict(file)
    ends = np.flatnonzero(rows["terminals"]) + 1
    assert len(ends) == COUNT
    for index, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        arrays = recorded(index)
        np.testing.assert_array_equal(rows["observations"][start:end], states(arrays))
        np.testing.assert_array_equal(rows["actions"][start : end - 1], arrays["action"])
        np.testing.assert_array_equal(rows["rewards"][start + 1 : end], arrays["reward"])
        if arguments is EXPERT:
            # Noise is at most 0.1 of its unit, and the last element of qpos that of the kettle.
            np.testing.assert_allclose(rows["qpos"][start:end, :9], states(arrays)[:, :9], atol=0.02)
            np.testing.assert_allclose(rows["qvel"][start:end, :9], states(arrays)[:, 9:18], atol=0.02)


def test_ogbenchs_validation_is_a_tenth(make):
    assert make("ogbench", *SHORT, "--num_episodes=20")[0] == 0
    counts = [np.load(f"data/me/{name}.npz")["terminals"].sum() for name in ("set", "set-val")]
    assert counts == [18, 2]


@pytest.mark.parametrize("arguments", [EXPERT, CABINET], ids=["kitchen", "cabinet"])
def test_robomimic(make, arguments):
    import h5py

    status, _, err = make("robomimic", *arguments)
    assert (status, err) == (0, "")
    with h5py.File("data/me/set.hdf5") as file:
        data = file["data"]
        assert data.attrs["total"] == sum(len(recorded(index)["reward"]) for index in range(COUNT))
        args = json.loads(data.attrs["env_args"])
        env = gymnasium.make(args["env_name"], **args["env_kwargs"])
        spec = RecordingFolder.open(Path("runs")).spec
        assert str(suite_env(env).composer_task) == str(suite_env(spec.make_environment()).composer_task)
        for index in range(COUNT):
            arrays, group = recorded(index), data[f"demo_{index}"]
            names = {name: name.removeprefix("observation/").replace("/", "_").replace(" ", "_") for name in arrays}
            for name, key in names.items():
                if name.startswith("observation"):
                    np.testing.assert_array_equal(group[f"obs/{key}"][:], arrays[name][:-1])
                    np.testing.assert_array_equal(group[f"next_obs/{key}"][:], arrays[name][1:])
            for name, key in {"actions": "action", "rewards": "reward", "terminations": "termination"}.items():
                np.testing.assert_array_equal(group[name][:], arrays[key])
            np.testing.assert_array_equal(group["dones"][:], arrays["termination"] | arrays["truncation"])
            assert group.attrs["num_samples"] == len(arrays["reward"]) == len(group["states"])
            assert group.attrs["model_file"].startswith("<mujoco")
            assert (np.diff(group["states"][:, 0]) > 0).all()


def test_diffusion_policy(make):
    import zarr

    status, _, err = make("diffusion_policy", *EXPERT)
    assert (status, err) == (0, "")
    root = zarr.open("data/me/set.zarr", mode="r")
    ends = root["meta/episode_ends"][:]
    assert ends.dtype == np.int64
    for index, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        arrays = recorded(index)
        np.testing.assert_array_equal(root["data/obs"][start:end], states(arrays)[:-1])
        np.testing.assert_array_equal(root["data/action"][start:end], arrays["action"])
        np.testing.assert_array_equal(root["data/reward"][start:end], arrays["reward"])


def test_bet(make):
    status, _, err = make("bet", *EXPERT)
    assert (status, err) == (0, "")
    observations, actions, mask = (
        np.load(f"data/me/set/{name}.npy") for name in ("observations_seq", "actions_seq", "existence_mask")
    )
    goals = tensor_in("data/me/set/onehot_goals.pth", (*mask.shape, 7))
    assert observations.shape == (*mask.shape, 60)
    for index in range(COUNT):
        arrays, steps = recorded(index), int(mask[:, index].sum())
        assert steps == len(arrays["reward"])
        assert (mask[:steps, index] == 1).all()
        np.testing.assert_array_equal(actions[:steps, index], arrays["action"])
        assert not observations[steps:, index].any()
        robot = np.r_[0:9]
        np.testing.assert_array_equal(observations[:steps, index][:, robot], states(arrays)[:-1][:, robot])
        completed = dict(
            zip(
                ["microwave", "kettle", "light switch", "slide cabinet"],
                arrays["info/completion_steps"][-1],
                strict=True,
            )
        )
        for task, step in completed.items():
            # The last step before a task is completed asks for it.
            assert goals[step - 1, index].argmax() == DEFAULT_TASKS.index(task)


def tensor_in(path, shape):
    """The numbers of a file of PyTorch's, read without it."""
    with zipfile.ZipFile(path) as archive:
        return np.frombuffer(archive.read("archive/data/0"), "<f4").reshape(shape)


@pytest.mark.clients
def test_pytorch_reads_bets_goals(tmp_path):
    import torch

    array = np.random.default_rng(0).normal(size=(4, 3, 7)).astype(np.float32)
    (tmp_path / "goals.pth").write_bytes(as_torch_file(array))
    read = torch.load(tmp_path / "goals.pth", weights_only=True)
    assert read.dtype == torch.float32
    np.testing.assert_array_equal(read.numpy(), array)


@pytest.mark.parametrize("name", ["robomimic", "diffusion_policy"])
def test_pictures_survive(make, name):
    status, _, err = make(name, *SHORT, *PICTURES)
    assert (status, err) == (0, "")
    arrays = {key: rows for key, rows in recorded(1).items() if rows.ndim == 4}
    assert arrays
    for key, rows in arrays.items():
        if name == "robomimic":
            import h5py

            with h5py.File("data/me/set.hdf5") as file:
                found = file[f"data/demo_1/obs/{key.removeprefix('observation/').replace('/', '_')}"][:]
        else:
            import zarr

            store = zarr.open("data/me/set.zarr", mode="r")
            found = store[f"data/{key.removeprefix('observation/').replace('/', '_')}"][5:10]
        np.testing.assert_array_equal(found, rows[:-1])


@pytest.mark.parametrize("name", ["ogbench", "d4rl", "bet"])
def test_a_format_without_pictures_says_so(make, name):
    status, _, err = make(name, *SHORT, *PICTURES)
    assert status == 2
    assert "holds no pictures" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", NAMES)
def test_a_dataset_is_made_once_and_never_replaced(make, name):
    assert make(name, *SHORT)[0] == 0
    assert make(name, *SHORT)[::2] == (0, "")
    status, _, err = make(name, *SHORT, "--num_episodes=2")
    assert status == 2
    assert "is of the first 3 episodes" in err
    plan = functools.partial(FORMATS[name].make_plan, count=COUNT)
    spec = EpisodeSpec.of(EpisodeSettings(task_name="kettle"), seeding="gymnasium")
    with refused(ValueError, "another recording"):
        plan("me/set", dataclasses.replace(spec, seed=9), root=Path("data"))
    other = plan("me/other", spec, root=Path("data"))
    other.path.mkdir()
    with refused(ValueError, "is not of this dataset"):
        plan("me/other", spec, root=Path("data"))
    with refused(ValueError, "no name"):
        plan("other", spec, root=Path("data"))
    with refused(ValueError, "--data_path"):
        plan("me/set", spec, root=None)


@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_ends_a_dataset_in_one_line_and_leaves_nothing(run, folder, name):
    """HDF5 may end the process by a signal, so another one makes the dataset."""
    assert run(record, *KITCHEN, *EXPERT)[0] == 0
    flags = [*KITCHEN, *EXPERT, f"--format={name}", "--dataset=me/set", "--data_path=data"]
    code = "from kitchen_suite.commands.commands import record; raise SystemExit(record())"
    with limited_files(30_000):
        done = subprocess.run([sys.executable, "-B", "-c", code, *flags], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1), done.stderr
    assert os.listdir("data/me") == []


@pytest.mark.clients
def test_ogbenchs_own_loader_reads_it(make):
    from ogbench.utils import load_dataset

    assert make("ogbench", *EXPERT)[0] == 0
    dataset = load_dataset("data/me/set.npz", ob_dtype=np.float64, add_info=True)
    arrays = [recorded(index) for index in range(COUNT)]
    np.testing.assert_array_equal(dataset["observations"], np.concatenate([states(each)[:-1] for each in arrays]))
    np.testing.assert_array_equal(dataset["next_observations"], np.concatenate([states(each)[1:] for each in arrays]))
    np.testing.assert_array_equal(dataset["actions"], np.concatenate([each["action"] for each in arrays]))
    assert dataset["qpos"].shape == (len(dataset["actions"]), 30)


def test_states_of_another_machine_are_refused(make):
    """The sparse reward is the same, 0."""
    assert make("d4rl", *SHORT)[0] == 0
    recording = RecordingFolder.open(Path("runs"))
    episode = recording.load(1)
    observations = {**episode.arrays, "observation/observation": episode.arrays["observation/observation"] + 1e-12}
    recording.save(dataclasses.replace(episode, arrays=observations), recording.load_stats(1))
    status, _, err = make("robomimic", *SHORT, "--dataset=me/other")
    assert (status, err.count("\n")) == (1, 1)
    assert "does not play again here, where its observation/observation differs" in err
    assert sorted(os.listdir("data/me")) == ["set.hdf5", "set.hdf5.kitchen_suite.json"]


def test_goals_are_those_of_the_requested_tasks(make):
    import h5py

    assert make("d4rl", "--policy=random", "--task_name=random_4", "--max_episode_steps=3")[0] == 0
    with h5py.File("data/me/set.hdf5") as file:
        goals, requested = file["observations"][::3, 30:], file["infos/requested_tasks"][::3]
    assert len(np.unique(requested, axis=0)) > 1
    tasks = EpisodeSpec.of(EpisodeSettings(task_name="random_4"), seeding="gymnasium").argument("tasks_to_complete")
    microwave = 30 - 8  # Its joint is before the seven of the kettle.
    np.testing.assert_allclose(goals[:, microwave], -0.75 * requested[:, tasks.index("microwave")])


def test_another_format_and_lost_files_are_told(make):
    assert make("d4rl", *SHORT)[0] == 0
    status, _, err = make("robomimic", *SHORT)
    assert (status, "is one for D4RL" in err) == (2, True)
    os.remove("data/me/set.hdf5")
    status, _, err = make("d4rl", *SHORT)
    assert (status, "is gone" in err) == (2, True)


def test_ogbenchs_validation_never_replaces_another_file(make):
    assert make("ogbench", *SHORT, "--dataset=me/set-val")[0] == 0
    before = Path("data/me/set-val.npz").read_bytes()
    status, _, err = make("ogbench", *SHORT, "--num_episodes=20")
    assert (status, "set-val.npz exists" in err) == (2, True)
    assert Path("data/me/set-val.npz").read_bytes() == before


@pytest.mark.parametrize(
    "arguments",
    [[*SHORT, '--task_kwargs={"obs_type": "state"}'], [*SHORT, '--task_kwargs={"goal_format": "flat"}'], CABINET],
)
def test_bet_needs_goals_by_task(make, arguments):
    status, _, err = make("bet", *arguments)
    assert (status, "goals by task" in err) == (2, True)


def test_pictures_alone_are_a_dataset(make):
    pictures = PICTURES[0].replace("pixels_agent_pos", "pixels")
    assert make("diffusion_policy", *SHORT, pictures)[::2] == (0, "")
    import zarr

    assert "obs" not in zarr.open("data/me/set.zarr", mode="r")["data"]

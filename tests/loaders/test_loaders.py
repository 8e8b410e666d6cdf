"""Datasets in the files of other programs, read with these programs' own loaders.

Each runs in a process of the Python that LOADERS_PYTHON names, where the programs' packages are installed. Programs
that no registry of packages has are read from checkouts of their repositories, which further variables name.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from kitchen_suite.commands.commands import record
from kitchen_suite.episodes.recording import RecordingFolder

COUNT = 10
READERS = Path(__file__).with_name("readers.py")
SHORT = ["--task_name=kettle", "--max_episode_steps=6"]
EXPERT = ["--task_name=complete", "--policy=expert", "--num_episodes=2"]
PICTURES = ['--task_kwargs={"obs_type": "pixels_agent_pos", "image_size": [64, 64], "render_quality": "fast"}']


def variable(name, meaning):
    """The value of an environment variable that the tests need."""
    if name not in os.environ:
        pytest.fail(f"set {name} to {meaning}", pytrace=False)
    return os.environ[name]


@pytest.fixture
def make(run, folder):
    """Records episodes in a format, in an empty folder; returns their arrays."""

    def make(name, *arguments):
        flags = ["--num_threads=1", "--output=runs", f"--num_episodes={COUNT}", "--num_envs=5", "--seed=5"]
        status, _, err = run(record, *flags, f"--format={name}", "--dataset=me/set", "--data_path=data", *arguments)
        assert (status, err) == (0, "")
        recording = RecordingFolder.open(Path("runs"))
        return [recording.load(index).arrays for index in recording.indices]

    return make


@pytest.fixture
def read():
    """Returns what a program's loader reads, with some folders on its path of modules."""
    python = variable("LOADERS_PYTHON", "a Python with the packages of the programs, such as .ci/run makes")

    def read(program, path, *checkouts):
        search = os.pathsep.join(map(str, checkouts))
        environment = {**os.environ, "PYTHONPATH": search, "OMP_NUM_THREADS": "1"}
        command = [python, READERS, program, path, "result.npz"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=200, env=environment)
        assert done.returncode == 0, done.stderr[-3000:]
        return dict(np.load("result.npz"))

    return read


@pytest.fixture
def diffusion_policy():
    return Path(variable("DIFFUSION_POLICY_CHECKOUT", "a checkout of Diffusion Policy"))


@pytest.fixture
def bet():
    return Path(variable("BET_CHECKOUT", "a checkout of BeT"))


@pytest.fixture
def ogbench():
    return Path(variable("OGBENCH_CHECKOUT", "a checkout of OGBench"))


def joined(episodes, name, rows=slice(None)):
    return np.concatenate([arrays[name][rows] for arrays in episodes])


@pytest.mark.loaders
@pytest.mark.parametrize(
    "arguments", [pytest.param([], id="states"), pytest.param(PICTURES, id="pictures", marks=pytest.mark.rendering)]
)
def test_robomimic_reads_and_clones(read, make, arguments):
    episodes = make("robomimic", *SHORT, *arguments)
    found = read("robomimic", "data/me/set.hdf5")
    assert 0.0 < found["loss"] < 1.0
    assert json.loads(str(found["env_meta"]))["env_name"] == "KitchenSuite/FrankaKitchen-v1"
    for part, chosen in {"valid": episodes[:1], "train": episodes[1:]}.items():
        np.testing.assert_array_equal(found[f"{part}/actions"], joined(chosen, "action"))
        np.testing.assert_array_equal(found[f"{part}/rewards"], joined(chosen, "reward"))
        np.testing.assert_array_equal(found[f"{part}/dones"], joined(chosen, "truncation"))
        for name in episodes[0]:
            if name.startswith("observation"):
                key = name.removeprefix("observation/").replace("/", "_")
                np.testing.assert_array_equal(found[f"{part}/obs/{key}"], joined(chosen, name, slice(-1)))
                np.testing.assert_array_equal(found[f"{part}/next_obs/{key}"], joined(chosen, name, slice(1, None)))


@pytest.mark.loaders
def test_d3rlpy_reads_and_learns_from_d4rls_layout(read, make):
    # Tasks that are completed terminate an episode; other episodes end at the limit of steps.
    expert = ["--policy=expert", "--task_name=microwave", "--num_episodes=4", "--max_episode_steps=35"]
    episodes = make("d4rl", *expert, '--task_kwargs={"variations": ["start"]}')
    found = read("d3rlpy", "data/me/set.hdf5")
    assert found["lengths"].tolist() == [len(arrays["reward"]) for arrays in episodes]
    assert {*found["terminated"]} == {True, False}
    assert found["terminated"].tolist() == [bool(arrays["termination"][-1]) for arrays in episodes]
    np.testing.assert_array_equal(found["actions"], joined(episodes, "action"))
    np.testing.assert_array_equal(found["rewards"][:, 0], joined(episodes, "reward"))
    robot = joined(episodes, "observation/observation", slice(-1))[:, :9]
    np.testing.assert_array_equal(found["observations"][:, :9], robot)
    assert found["observations"].shape[1] == 60
    assert np.isfinite(found["losses"]).all()


@pytest.mark.checkouts
def test_diffusion_policys_replay_buffer_reads_it(read, diffusion_policy, make):
    episodes = make("diffusion_policy", *SHORT)
    found = read("diffusion_policy", "data/me/set.zarr", diffusion_policy)
    np.testing.assert_array_equal(found["episode_ends"], 6 * np.arange(1, COUNT + 1))
    np.testing.assert_array_equal(found["action"], joined(episodes, "action"))
    np.testing.assert_array_equal(found["reward"], joined(episodes, "reward"))
    np.testing.assert_array_equal(found["obs"], joined(episodes, "observation/observation", slice(-1)))


@pytest.mark.checkouts
def test_diffusion_policys_kitchen_reads_bets_arrays(read, diffusion_policy, make):
    episodes = make("bet", *EXPERT)
    found = read("diffusion_policy_kitchen", "data/me/set", diffusion_policy)
    np.testing.assert_array_equal(found["action"], joined(episodes, "action"))
    robot = joined(episodes, "observation/observation", slice(-1))[:, :9]
    np.testing.assert_array_equal(found["obs"][:, :9], robot.astype(np.float32))


@pytest.mark.checkouts
def test_bets_kitchen_reads_it(read, bet, make):
    episodes = make("bet", *EXPERT)
    found = read("bet", "data/me/set", bet)
    assert found["lengths"].tolist() == [len(arrays["reward"]) for arrays in episodes]
    for index, arrays in enumerate(episodes):
        steps = len(arrays["reward"])
        np.testing.assert_array_equal(found["actions"][index, :steps], arrays["action"])
        robot = arrays["observation/observation"][:-1, :9].astype(np.float32)
        np.testing.assert_array_equal(found["observations"][index, :steps, :9], robot)
        # The expert completes the four tasks, after which no task is next.
        assert found["goals"][:steps, index].sum() == arrays["info/completion_steps"][-1].max()


@pytest.mark.checkouts
def test_ogbenchs_agents_sample_from_it(read, ogbench, make):
    episodes = make("ogbench", *SHORT, "--num_episodes=5")
    found = read("ogbench", "data/me/set.npz", ogbench, ogbench / "impls")
    np.testing.assert_array_equal(found["actions"], joined(episodes, "action"))
    np.testing.assert_array_equal(found["observations"], joined(episodes, "observation/observation", slice(-1)))
    np.testing.assert_array_equal(
        found["next_observations"], joined(episodes, "observation/observation", slice(1, None))
    )
    for number, goal in enumerate(found["actor_goals"]):
        index, step = divmod(number, 6)
        later = episodes[index]["observation/observation"][step:]
        assert (later == goal).all(axis=1).any()

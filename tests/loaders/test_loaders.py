"""Datasets in the files of other programs, read with these programs' own loaders.

Each runs in a process of the Python that LOADERS_PYTHON names, where the programs' packages are installed.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from kitchen_suite.commands import convert, record
from kitchen_suite.episodes.recording import Recording

COUNT = 10
READERS = Path(__file__).with_name("readers.py")
SHORT = ["--task_name=kettle", "--max_episode_steps=6"]
PICTURES = ['--task_kwargs={"obs_type": "pixels_agent_pos", "image_size": [64, 64], "render_quality": "fast"}']


@pytest.fixture
def make(run, folder):
    """Records episodes and converts them to a format, in an empty folder; returns their arrays."""

    def make(name, *arguments):
        flags = ["--num_threads=1", "--output=runs", f"--num_episodes={COUNT}", "--num_envs=5", "--seed=5"]
        assert run(record, *flags, *arguments)[0] == 0
        status, _, err = run(convert, "runs", f"--format={name}", "--dataset=me/set", "--data_path=data")
        assert (status, err) == (0, "")
        recording = Recording.open(Path("runs"))
        return [recording.load(index).arrays for index in recording.indices]

    return make


@pytest.fixture
def read():
    """Returns what a program's loader reads."""
    if "LOADERS_PYTHON" not in os.environ:
        pytest.fail("set LOADERS_PYTHON to a Python with the packages of the programs, such as .ci/run makes")

    def read(program, path):
        environment = {**os.environ, "PYTHONPATH": "", "OMP_NUM_THREADS": "1"}
        command = [os.environ["LOADERS_PYTHON"], READERS, program, path, "result.npz"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=200, env=environment)
        assert done.returncode == 0, done.stderr[-3000:]
        return dict(np.load("result.npz"))

    return read


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
    assert json.loads(str(found["env_meta"]))["env_name"] == "kitchen_suite:KitchenSuite/FrankaKitchen-v1"
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

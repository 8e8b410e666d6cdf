"""Writers on a full disk: one line, status 1, nothing left behind, and never a signal.

The disk is full where a file may not grow beyond a size: `RLIMIT_FSIZE` of the process that writes, which needs no
rights. Data sets of HDF5 are written by a library that ends the process if it finds that out itself.
"""

import os
import resource
import subprocess
import sys

import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite.datasets import hdf5

TASK = ("--domain_name=kitchen", "--task_name=kettle", "--policy=random", "--max_episode_steps=20")
EVALUATION = ("kitchen-evaluate", "--task_name=kettle", "--policy=random", "--num_episodes=3", "--max_episode_steps=20")

# Arguments by name of the writer; FOLDER is where it writes, RECORDING what it reads.
WRITERS = {
    **{
        name: ("kitchen-convert", "RECORDING", f"--format={name}", f"--dataset=me/set{end}", "--data_path=FOLDER/sets")
        for name, end in {"minari": "-v0", "robomimic": "", "d4rl": "", "ogbench": ""}.items()
    },
    "record": ("kitchen-record", *TASK, "--num_episodes=3", "--output=FOLDER/recording"),
    "rollout": ("kitchen-rollout", *TASK, "--num_episodes=3", "--output=FOLDER/recording"),
    "json": (*EVALUATION, "--episodes", "--json=FOLDER/evaluation.json"),
    "output": (*EVALUATION, "--output=FOLDER/evaluation"),
    "receipt": (*EVALUATION, "--receipt=FOLDER/receipt.npz"),
    "export": ("kitchen-export", *TASK[:2], "--output=FOLDER/scene"),
}
# They keep what was finished before: episodes of a recording, results of an evaluation.
KEEPS = {"record", "rollout", "output"}

SIZES = [2**power for power in range(11)]  # [KiB]
FEW = [1, 64]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full_disk") / "recording"
    run(("kitchen-record", *TASK, "--num_episodes=4", f"--output={folder}"), None).check_returncode()
    return folder


def run(arguments, size):
    """Runs a command in which no file may be longer than a size [KiB]; None for no limit."""
    name, *others = arguments
    code = (
        f"import sys; from kitchen_suite.commands.{name.removeprefix('kitchen-')} import COMMAND; sys.exit(COMMAND())"
    )

    def limit():
        if size is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size * 1024, size * 1024))

    # Python's own compiled files are not what is tested.
    environ = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code, *others]
    return subprocess.run(command, preexec_fn=limit, env=environ, capture_output=True, text=True)


@pytest.mark.full
@pytest.mark.parametrize(
    ("writer", "size"),
    [
        pytest.param(writer, size, marks=() if size in FEW else pytest.mark.nightly)
        for writer in WRITERS
        for size in SIZES
    ],
)
def test_a_writer_on_a_full_disk_ends_with_one_line_and_leaves_nothing(writer, size, recording, tmp_path):
    folder = tmp_path / "disk"
    folder.mkdir()
    names = {"FOLDER": str(folder), "RECORDING": str(recording)}
    arguments = WRITERS[writer]
    for name, path in names.items():
        arguments = [argument.replace(name, path) for argument in arguments]
    done = run(arguments, size)
    if done.returncode == 0:
        # It fits: what was asked for is there.
        assert [path for path in folder.rglob("*") if path.is_file()]
        return
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1), (done.returncode, done.stderr)
    assert "Errno" in done.stderr
    left = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))
    assert not [path for path in left if "/." in f"/{path}"]
    # A description alone is of no use.
    assert left == [] or (writer in KEEPS and len(left) > 2)


def test_hdf5_files_without_space_are_refused_before_their_library_writes(tmp_path, monkeypatch):
    path = tmp_path / "set.hdf5"

    def full(descriptor, offset, length):
        raise OSError(28, "No space left on device")

    with hdf5.new_file(path) as file:
        hdf5.append(file, {"a": np.zeros((3, 2))})
        monkeypatch.setattr(os, "posix_fallocate", full)
        with refused(OSError, "No space left on device", "HDF5"):
            hdf5.append(file, {"a": np.zeros((5, 2))})
        monkeypatch.undo()
        assert file["a"].shape == (3, 2)
    assert path.exists()

"""`kitchen-convert` between recordings and datasets of other programs: to the bit, or refused in one line."""

import contextlib
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers.human_files import write_d4rl

from kitchen_suite import files
from kitchen_suite.commands.commands import convert, record, replay, rollout
from kitchen_suite.episodes.recording import RecordingFolder

COUNT = 11
SHORT = ["--task_name=kettle", "--max_episode_steps=3"]
FILES = {
    "robomimic": "set.hdf5",
    "ogbench": "set.npz",
    "d4rl": "set.hdf5",
    "diffusion_policy": "set.zarr",
    "bet": "set",
}
RECORDINGS = {
    "drawn tasks": [
        "--task_name=random_4",
        "--max_episode_steps=5",
        '--task_kwargs={"variations": ["start", "dynamics"]}',
    ],
    "the expert": ["--task_name=microwave", "--policy=expert", "--max_episode_steps=35"],
    "cabinet": ["--domain_name=open_cabinet", "--max_episode_steps=5"],
    "pictures": [*SHORT, '--task_kwargs={"obs_type": "pixels_agent_pos", "image_size": [16, 20]}'],
}
LACKING = {("bet", "cabinet"), *((name, "pictures") for name in ("bet", "ogbench", "d4rl"))}


@pytest.fixture
def make(run, folder):
    """Records episodes, in an empty folder."""

    def make(*arguments, count=COUNT):
        flags = ["--num_threads=1", "--output=runs", f"--num_episodes={count}", "--num_envs=6", "--seed=5"]
        status, _, error = run(record, *flags, *arguments)
        assert (status, error) == (0, "")

    return make


def to_dataset(name, dataset="me/set"):
    return "runs", f"--format={name}", f"--dataset={dataset}", "--data_path=data"


def digest(folder):
    recording = RecordingFolder.open(Path(folder))
    return recording.digest(recording.indices), recording.spec


def contents():
    return {path: path.is_file() and path.read_bytes() for path in Path().rglob("*")}


def check_round_trip(run, name):
    path = f"data/me/{FILES[name]}"
    status, out, error = run(convert, *to_dataset(name))
    assert (status, error) == (0, "")
    assert f"dataset me/set in {path}" in out
    status, out, error = run(convert, path, "--output=back")
    assert (status, error) == (0, "")
    assert f"{COUNT} episodes of {path}" in out
    assert digest("back") == digest("runs")


@pytest.mark.thorough
def test_a_dataset_of_a_recording_becomes_the_recording_again(make, run):
    make(*SHORT)
    check_round_trip(run, "d4rl")
    assert run(replay, "back", "--episodes=all")[0] == 0
    # Both commands again: what is there stays.
    before = contents()
    assert run(convert, *to_dataset("d4rl"))[::2] == (0, "")
    assert run(convert, "data/me/set.hdf5", "--output=back")[::2] == (0, "")
    assert contents() == before


def test_a_dataset_of_fewer_episodes_is_not_taken_for_one_of_all(make, run):
    make(*SHORT)
    recorded = sorted(Path("runs").glob("episode_*.npz"))
    content = recorded[1].read_bytes()
    recorded[1].unlink()
    assert run(convert, *to_dataset("d4rl"))[0] == 0
    recorded[1].write_bytes(content)
    status, _, error = run(convert, *to_dataset("d4rl"))
    assert (status, error.count("\n")) == (1, 1)
    assert "dataset 'me/set' has other episodes of this recording: name another one" in error
    arguments = ["--num_threads=1", "--output=runs", f"--num_episodes={COUNT}", "--num_envs=6", "--seed=5", *SHORT]
    status, _, error = run(record, *arguments, *to_dataset("d4rl")[1:])
    assert status == 1
    assert "other episodes" in error


@pytest.mark.thorough
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.rendering if kind == "pictures" else []) for kind in RECORDINGS]
)
@pytest.mark.parametrize("name", FILES)
def test_every_format_comes_back_to_the_bit(make, run, name, kind):
    make(*RECORDINGS[kind])
    if (name, kind) in LACKING:
        status, _, error = run(convert, *to_dataset(name))
        assert (status, error.count("\n")) == (2, 1)
        assert not Path("data").exists()
        return
    check_round_trip(run, name)
    # kitchen-record knows the dataset as its own.
    arguments = ["--num_threads=1", "--output=runs", f"--num_episodes={COUNT}", "--num_envs=6", "--seed=5"]
    arguments += [*RECORDINGS[kind], *to_dataset(name)[1:]]
    before = contents()
    assert run(record, *arguments)[::2] == (0, "")
    assert contents() == before


def test_other_programs_formats_are_made_of_recordings_as_well(make, run):
    make(*SHORT, count=2)
    assert run(convert, "runs", "--dataset=me/kettle-v0")[::2] == (0, "")
    assert run(replay, "me/kettle-v0")[0] == 0


def test_bad_arguments_are_refused_in_one_line(make, refusal, run):
    make(*SHORT, count=1)
    for arguments, shown in {
        ("runs",): "--output",
        (*to_dataset("d4rl"), "--output=back"): "--output",
        ("runs", "--format=d4rl"): "--dataset",
        ("runs", "--format=d4rl", "--output=back"): "--format=d4rl",
        ("runs", "--output=back"): "recording of this suite already",
        ("nowhere", *to_dataset("d4rl")[1:]): "nowhere",
        to_dataset("hdf5"): "'hdf5'",
        to_dataset("lerobot"): "obs_type",
        to_dataset("d4rl", "set"): "'set'",
        to_dataset("d4rl")[:-1]: "--data_path",
    }.items():
        assert shown in refusal(convert, *arguments), arguments
    assert not Path("data").exists()
    assert run(rollout, "--num_episodes=1", "--max_episode_steps=2", "--output=rolled")[0] == 0
    write_d4rl("human.hdf5")
    assert run(convert, "human.hdf5", "--output=human")[0] == 0
    for source, maker in {"rolled": "kitchen-rollout", "human": "kitchen-convert"}.items():
        assert maker in refusal(convert, source, *to_dataset("d4rl")[1:])


def changed(path, change):
    """Changes the arrays of a dataset by name, in whatever files they are."""
    import h5py
    import zarr

    path = Path(path)
    if path.suffix == ".hdf5":
        with h5py.File(path, "r+") as file:
            names = []
            file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
            for name in [name for name in names if not name.startswith("mask")]:
                rows = file[name][()]
                made = change(name.rpartition("/")[2], rows)
                if made is not rows:
                    del file[name]
                    file[name] = made
    elif path.suffix == ".npz":
        arrays = {name: change(name, rows) for name, rows in np.load(path).items()}
        np.savez_compressed(path, **arrays)
    elif path.suffix == ".zarr":
        data = zarr.open_group(str(path))["data"]
        for name, rows in list(data.arrays()):
            data.create_dataset(name, data=change(name, rows[:]), overwrite=True)
    else:
        for file in path.glob("*.npy"):
            np.save(file, change(file.stem, np.load(file)))


def one_bit(wanted):
    """Changes a bit of the last number of an array."""

    def change(name, rows):
        if name == wanted:
            rows = rows.copy()
            rows.reshape(-1).view(np.uint8)[0] ^= 1
        return rows

    return change


def without_a_column(name, rows):
    return rows[..., :-1] if name.startswith("action") else rows


def beyond_bounds(name, rows):
    return rows * 7 if name.startswith("action") else rows


def without_a_row(name, rows):
    return rows[:-1]


CHANGES = {
    "rewards": (one_bit("rewards"), ["robomimic", "ogbench", "d4rl"]),
    "reward": (one_bit("reward"), ["diffusion_policy"]),
    "states": (one_bit("states"), ["robomimic"]),
    "qvel": (one_bit("qvel"), ["ogbench"]),
    "next_observations": (one_bit("next_observations"), ["d4rl"]),
    "obs": (one_bit("obs"), ["diffusion_policy"]),
    "observations_seq": (one_bit("observations_seq"), ["bet"]),
    "actions": (one_bit("actions"), ["robomimic", "ogbench", "d4rl"]),
    "actions_seq": (one_bit("actions_seq"), ["bet"]),
    "eight numbers an action": (without_a_column, FILES),
    "actions beyond the bounds": (beyond_bounds, FILES),
    "a row less": (without_a_row, FILES),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", FILES)
def test_changed_datasets_are_refused_in_one_line(make, run, refusal, name):
    make(*SHORT, count=2)
    assert run(convert, *to_dataset(name))[0] == 0
    for case, (change, names) in CHANGES.items():
        if name in names:
            shutil.copytree("data", case)
            path = f"{case}/me/{FILES[name]}"
            changed(path, change)
            assert path in refusal(convert, path, "--output=back", status=1)
    assert not Path("back").exists()


@pytest.mark.thorough
@pytest.mark.parametrize("name", FILES)
def test_actions_that_the_environment_would_clip_are_refused(make, run, refusal, monkeypatch, name):
    text = "import numpy as np\n\n\ndef act(timestep):\n    return np.ones(9)\n"
    Path("greatest.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(Path.cwd())
    make(*SHORT, "--policy=greatest:act", count=2)
    assert run(convert, *to_dataset(name))[0] == 0
    changed(f"data/me/{FILES[name]}", beyond_bounds)
    message = refusal(convert, f"data/me/{FILES[name]}", "--output=back", status=1)
    assert "actions beyond the bounds" in message


DAMAGED_RECORDS = {
    "a seed less": lambda record: record | {"seeds": record["seeds"][:-1]},
    "no seeds": lambda record: record | {"seeds": []},
    "another order": lambda record: record | {"seeds": [6, 5]},
    "earlier seeds": lambda record: record | {"seeds": [1, 2]},
    "a format that has no record": lambda record: record | {"format": "Minari"},
    "another format": lambda record: record | {"format": "robomimic"},
    "no specification": lambda record: record | {"recording": {}},
    "an unknown task": lambda record: record | {"recording": record["recording"] | {"task_name": "nothing"}},
    "human episodes": lambda record: record | {"recording": record["recording"] | {"origin": {}}},
    "another kind of JSON": lambda record: record["seeds"],
}


@pytest.mark.thorough
def test_damaged_records_are_refused_in_one_line(make, run):
    make(*SHORT, count=2)
    assert run(convert, *to_dataset("d4rl"))[0] == 0
    path = Path("data/me/set.hdf5.kitchen_suite.json")
    text = path.read_text()
    for case, change in DAMAGED_RECORDS.items():
        path.write_text(json.dumps(change(json.loads(text))))
        status, _, error = run(convert, "data/me/set.hdf5", "--output=back")
        assert status in (1, 2), case
        assert (error.count("\n"), error.startswith("kitchen-convert: ")) == (1, True), error
    assert not Path("back").exists()


@pytest.mark.thorough
def test_files_of_other_programs_need_their_record(make, run, refusal):
    make(*SHORT, count=2)
    for name, file in FILES.items():
        assert run(convert, *to_dataset(name, f"me/{name}"))[0] == 0
        path = Path("data/me", file.replace("set", name))
        os.remove(f"{path}.kitchen_suite.json")
        if name != "d4rl":  # As D4RL's own files, of which no record is needed.
            assert str(path) in refusal(convert, str(path), "--output=back")
    error = refusal(convert, "data/me/robomimic.hdf5", "--output=back")
    assert "robomimic.hdf5.kitchen_suite.json" in error
    assert run(convert, "data/me/d4rl.hdf5", "--output=back")[0] == 0


@contextlib.contextmanager
def disk(size):
    """Mounts a disk of `size` bytes at `disk`, for which root is needed."""
    os.makedirs("disk", exist_ok=True)
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", "disk"], capture_output=True)
    if done.returncode:
        pytest.skip("only root mounts disks")
    try:
        yield
    finally:
        subprocess.run(["umount", "disk"], check=True)


@pytest.mark.thorough
@pytest.mark.parametrize("name", FILES)
def test_a_disk_that_is_full_ends_a_dataset_wherever_it_has_come_to(make, run, refusal, name):
    make(*SHORT)
    assert run(convert, *to_dataset(name))[0] == 0
    size = sum(path.stat().st_size for path in Path("data").rglob("*") if path.is_file())
    arguments = [*to_dataset(name)[:-1], "--data_path=disk"]
    for share in (0.05, 0.35, 0.65, 0.95):
        with disk(max(8192, int(share * size))):
            assert "No space left" in refusal(convert, *arguments, status=1)
            assert os.listdir("disk/me") == []
            # There is room again.
            subprocess.run(["mount", "-o", "remount,size=64M", "disk"], check=True)
            if share == 0.35:
                assert run(convert, *arguments)[::2] == (0, "")
                made = Path("disk/me", FILES[name])
                assert run(convert, str(made), "--output=back")[::2] == (0, "")
                assert digest("back") == digest("runs")


@pytest.mark.thorough
@pytest.mark.parametrize("name", FILES)
def test_a_write_that_fails_leaves_nothing_and_the_same_command_makes_the_dataset(
    make, run, refusal, monkeypatch, name
):
    """As on a disk that others fill: room was reserved, or not needed, and then the n-th write finds none."""
    make(*SHORT)
    fail = OSError(28, os.strerror(28))
    # What writes most of a format.
    target, attribute, calls = {
        "robomimic": (files, "reserve", 9),
        "ogbench": (np.lib.format, "write_array", 4),
        "d4rl": (files, "reserve", 5),
        "diffusion_policy": (os, "replace", 7),
        "bet": (np, "save", 2),
    }[name]
    original, left = getattr(target, attribute), [calls]

    def write(*arguments, **keywords):
        left[0] -= 1
        if not left[0]:
            raise fail
        return original(*arguments, **keywords)

    with monkeypatch.context() as patch:
        patch.setattr(target, attribute, write)
        assert "No space left" in refusal(convert, *to_dataset(name), status=1)
    assert os.listdir("data/me") == []
    check_round_trip(run, name)

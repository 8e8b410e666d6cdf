"""`kitchen-convert` makes datasets of recordings: whole or absent, never in place of another one."""

import contextlib
import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.human_files import write_d4rl
from minari.dataset.minari_dataset import MinariDataset

from kitchen_suite.commands import convert, record, rollout
from kitchen_suite.datasets import ogbench
from kitchen_suite.datasets.convert import convert as convert_recording
from kitchen_suite.datasets.formats import FORMATS
from kitchen_suite.episodes.episode import PHYSICS_STATE

SHORT = ["--num_threads=1", "--output=runs", "--num_envs=2", "--seed=5", "--task_name=kettle", "--max_episode_steps=3"]
PICTURES = '--task_kwargs={"obs_type": "pixels", "image_size": [8, 8], "render_quality": "fast"}'
FILES = {"robomimic": "set.hdf5", "ogbench": "set.npz", "d4rl": "set.hdf5", "minari": "set-v0"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with a recording of two episodes of three control steps."""
    folder = tmp_path_factory.mktemp("recorded")
    with contextlib.chdir(folder):
        assert record.main([*SHORT, "--num_episodes=2"]) == 0
    return folder


@pytest.fixture
def make(run, recorded, folder):
    """Makes a recording of episodes of three control steps, in an empty folder."""

    def make(*arguments, count=2):
        if not arguments and count == 2:
            shutil.copytree(recorded / "runs", folder / "runs")
            return
        status, _, error = run(record, *SHORT, f"--num_episodes={count}", *arguments)
        assert (status, error) == (0, "")

    return make


def to_dataset(name, dataset=None):
    return "runs", f"--format={name}", f"--dataset={dataset or f'me/{Path(FILES[name]).stem}'}", "--data_path=data"


def contents():
    return {path: path.is_file() and path.read_bytes() for path in Path("data").rglob("*")}


@pytest.mark.full
def test_minari_is_the_default(make, run):
    make()
    status, out, error = run(convert, "runs", "--dataset=me/kettle-v0")
    assert (status, error) == (0, "")
    assert out == f"dataset me/kettle-v0 of runs in {os.getcwd()}/datasets/me/kettle-v0\n"


@pytest.mark.full
@pytest.mark.parametrize("name", FILES)
def test_a_dataset_is_made_once_and_never_replaced(make, run, refusal, name):
    make()
    status, out, error = run(convert, *to_dataset(name))
    assert (status, error) == (0, "")
    assert f"data/me/{FILES[name]}" in out
    before = contents()
    assert f"{FILES[name]} exists already, and is never replaced" in refusal(convert, *to_dataset(name))
    assert contents() == before


@pytest.mark.full
def test_ogbenchs_validation_never_replaces_another_file(make, run, refusal):
    make(count=10)
    assert run(convert, *to_dataset("ogbench", "me/set-val"))[0] == 0
    before = contents()
    assert "set-val.npz exists already" in refusal(convert, *to_dataset("ogbench"))
    assert contents() == before


@pytest.mark.full
def test_it_is_a_function_of_plain_arguments(make):
    make()
    made = convert_recording("runs", "d4rl", "me/set", "data")
    assert made == Path("data/me/set.hdf5")
    with h5py.File(made) as file:
        assert len(file["actions"]) == 6


@pytest.mark.full
def test_bad_arguments_are_refused_in_one_line(make, refusal, run):
    make(count=1)
    for arguments, shown in {
        ("runs",): "either a dataset, OWNER/NAME",
        (*to_dataset("d4rl"), "--output=back"): "either a dataset, OWNER/NAME",
        ("runs", "--format=d4rl"): "either a dataset, OWNER/NAME",
        ("runs", "--format=d4rl", "--output=back"): "leave out 'd4rl'",
        ("runs", "--output=back"): "recording of this suite already",
        ("nowhere", *to_dataset("d4rl")[1:]): "nowhere",
        ("runs", "--format=hdf5", "--dataset=me/set"): "'hdf5'",
        ("runs", "--format=lerobot", "--dataset=me/set"): "obs_type",
        ("runs", "--dataset=kitchen"): "it lacks a version, as in kitchen-v0",
        ("runs", "--dataset=a b-v0"): "'a b-v0' is no name of a dataset",
        to_dataset("d4rl", "set"): "'set'",
        to_dataset("d4rl", "me/../set"): "no name of a dataset",
        to_dataset("d4rl")[:-1]: "data_path",
    }.items():
        assert shown in refusal(convert, *arguments), arguments
    assert not Path("data").exists()
    assert not Path("datasets").exists()
    assert run(rollout, "--num_episodes=1", "--max_episode_steps=2", "--output=rolled")[0] == 0
    write_d4rl("human.hdf5")
    assert run(convert, "human.hdf5", "--output=human")[0] == 0
    for source, maker in {"rolled": "kitchen-rollout", "human": "kitchen-convert"}.items():
        assert maker in refusal(convert, source, *to_dataset("d4rl")[1:])
    os.remove("runs/episode_000000.npz")
    assert "runs holds no episodes" in refusal(convert, *to_dataset("d4rl"))


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize("name", ["ogbench", "d4rl"])
def test_a_format_without_pictures_says_so(make, refusal, name):
    make(PICTURES)
    title = FORMATS[name].title
    assert f"a dataset for {title} holds no pictures: record other observations" in refusal(convert, *to_dataset(name))


@pytest.mark.full
@pytest.mark.parametrize("name", ["robomimic", "ogbench"])
def test_a_recording_without_physics_states_is_to_be_recorded_again(make, refusal, run, name):
    make()
    for path in Path("runs").glob("episode_*.npz"):
        with np.load(path) as file:
            arrays = dict(file)
        del arrays[PHYSICS_STATE]
        np.savez_compressed(path, **arrays)
    assert f"lacks the array {PHYSICS_STATE}" in refusal(convert, *to_dataset(name))
    assert not os.path.exists("data")
    assert run(convert, *to_dataset("d4rl"))[0] == 0


# A function of each format that is called for every episode, or part of one.
WRITES = {
    "robomimic": (h5py.Group, "create_dataset"),
    "ogbench": (ogbench, "columns_of"),
    "d4rl": (h5py.Dataset, "resize"),
    "minari": (MinariDataset, "update_dataset_from_buffer"),
}


@pytest.mark.full
@pytest.mark.parametrize("name", FILES)
def test_a_write_that_fails_leaves_nothing(make, run, refusal, monkeypatch, name):
    make()

    def fail(*arguments, **options):
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patch:
        patch.setattr(*WRITES[name], fail)
        assert "No space left" in refusal(convert, *to_dataset(name), status=1)
    assert not [path for path in Path("data").rglob("*") if path.is_file()]
    assert run(convert, *to_dataset(name))[::2] == (0, "")


@pytest.mark.full
def test_an_interrupt_leaves_nothing(make, run, monkeypatch):
    make()

    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(h5py.Dataset, "resize", interrupt)
    status, _, error = run(convert, *to_dataset("d4rl"))
    message = "kitchen-convert: interrupted\n"
    assert (status, error) == (130, message)
    assert not os.path.exists("data")


@pytest.mark.full
def test_a_dataset_has_the_episodes_that_are_there(make, run):
    make(count=3)
    os.remove("runs/episode_000001.npz")
    assert run(convert, *to_dataset("d4rl"))[0] == 0
    expected = [load_episode(f"runs/episode_{index:06d}.npz")[1]["action"] for index in (0, 2)]
    with h5py.File("data/me/set.hdf5") as file:
        np.testing.assert_array_equal(file["actions"][()], np.concatenate(expected))


@pytest.mark.full
def test_seeds_that_hdf5_cannot_hold_are_refused(make, run, refusal):
    make(f"--seed={2**63 - 2}")
    assert run(convert, *to_dataset("d4rl"))[0] == 0
    make("--output=greater", f"--seed={2**63 - 1}")
    error = refusal(convert, "greater", *to_dataset("minari")[1:])
    assert f"seeds in a dataset may not exceed {2**63 - 1}, got {2**63}" in error

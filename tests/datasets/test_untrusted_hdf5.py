"""HDF5 files that take their contents from elsewhere, or would take gigabytes: refused before they are read."""

import itertools
import json
import os
import resource
import shutil

import h5py
import numpy as np
import pytest
from helpers.errors import refused
from helpers.human_files import write_d4rl, write_minari
from helpers.sweeps import brief

from kitchen_suite.commands import convert
from kitchen_suite.datasets import hdf5, minari

NAMES = ("observations", "actions", "terminals", "timeouts")


@pytest.fixture
def source(tmp_path):
    """A valid file."""
    path = tmp_path / "kitchen.hdf5"
    write_d4rl(path)
    return path


def replaced(path, name, make):
    """Replaces an array in a file by what a function makes."""
    with h5py.File(path, "a") as file:
        array = file[name][()]
        del file[name]
        make(file, name, array)


def external_storage(file, name, array):
    np.full(array.shape, 0.5, np.float32).tofile("secret.bin")
    external = [("secret.bin", 0, array.size * 4)]
    file.create_dataset(name, array.shape, "f4", external=external)


def external_link(file, name, array):
    with h5py.File("other.hdf5", "w") as other:
        other[name] = array
    file[name] = h5py.ExternalLink("other.hdf5", name)


def soft_link(file, name, array):
    file["elsewhere"] = array
    file[name] = h5py.SoftLink("/elsewhere")


def virtual(file, name, array):
    with h5py.File("other.hdf5", "w") as other:
        other["x"] = array
    layout = h5py.VirtualLayout(array.shape, array.dtype)
    layout[:] = h5py.VirtualSource("other.hdf5", "x", shape=array.shape)
    file.create_virtual_dataset(name, layout)


def virtual_of_itself(file, name, array):
    layout = h5py.VirtualLayout(array.shape, array.dtype)
    layout[:] = h5py.VirtualSource(".", name, shape=array.shape)
    file.create_virtual_dataset(name, layout)


def null_space(file, name, array):
    file[name] = h5py.Empty("f4")


def a_group(file, name, array):
    file.create_group(name)["x"] = array


def a_type(file, name, array):
    file[name] = np.dtype("f4")


def texts(file, name, array):
    file.create_dataset(name, array.shape, h5py.string_dtype())


def references(file, name, array):
    file.create_dataset(name, array.shape, h5py.ref_dtype)


def fields(file, name, array):
    file.create_dataset(name, array.shape, np.dtype([("a", "f4"), ("b", "i8")]))


def huge(file, name, array):
    shape = (2**40, *array.shape[1:])
    file.create_dataset(name, shape, "i1", chunks=(2**10, *array.shape[1:]), compression="gzip")


def huge_as_numbers(file, name, array):
    """Some 500 MB of bytes, which would be eight times as many as numbers."""
    width = int(np.prod(array.shape[1:]))
    shape = (500 * 2**20 // width, *array.shape[1:])
    file.create_dataset(name, shape, "i1", chunks=(2**14, *array.shape[1:]), compression="gzip")


HOSTILE = (
    *(external_storage, external_link, soft_link, virtual, virtual_of_itself, a_group, a_type, texts),
    *(references, fields, huge, huge_as_numbers),
)


@pytest.mark.parametrize("make", HOSTILE, ids=lambda make: make.__name__)
def test_an_array_that_is_not_in_its_file_is_refused(source, tmp_path, monkeypatch, make):
    monkeypatch.chdir(tmp_path)
    replaced(source, "actions", make)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(OSError, match="does not hold HDF5"):
        hdf5.read_arrays(source, NAMES)
    # 256 MiB, of the half a gigabyte that some declare.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**18


def test_other_arrays_are_not_opened(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    replaced(source, "infos", virtual_of_itself)
    replaced(source, "rewards", external_link)
    assert {*hdf5.read_arrays(source, NAMES)} == {"observations", "actions", "terminals"}
    # One of a null dataspace has nothing.
    replaced(source, "terminals", null_space)
    assert {*hdf5.read_arrays(source, NAMES)} == {"observations", "actions"}


def test_a_fifo_is_refused(tmp_path):
    os.mkfifo(tmp_path / "kitchen.hdf5")
    with refused(OSError, "not a regular file"):
        hdf5.read_arrays(tmp_path / "kitchen.hdf5", NAMES)


def test_filters_of_others_are_refused(source):
    with h5py.File(source, "a") as file:
        del file["actions"]
        created = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        created.set_chunk((10, 9))
        # One that is not required may be missing here.
        created.set_filter(32008, h5py.h5z.FLAG_OPTIONAL, (0,))
        space = h5py.h5s.create_simple((10, 9))
        h5py.h5d.create(file.id, b"actions", h5py.h5t.NATIVE_FLOAT, space, created)
    with pytest.raises(OSError, match="filters"):
        hdf5.read_arrays(source, NAMES)


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "value"),
    brief(
        itertools.product(NAMES[:3], (1e300, 1e11, np.nan, np.inf)),
        [("observations", 1e11), ("observations", np.nan), ("actions", np.inf), ("terminals", 1e300)],
    ),
)
def test_numbers_beyond_those_of_a_simulation_are_refused(source, tmp_path, capsys, name, value):
    def with_value(file, name, array):
        array = array.astype(np.float64)
        array.flat[3] = value
        file[name] = array

    replaced(source, name, with_value)
    assert convert.main([str(source), f"--output={tmp_path / 'human'}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.fixture
def dataset(tmp_path):
    """Folder of the data of a Minari dataset."""
    with minari.folder(tmp_path):
        write_minari("x-v0")
    return tmp_path / "x-v0" / "data"


def loop(file):
    file["episode_1/observations/again"] = file["episode_1"]


def outside(file):
    shutil.copy(file.filename, "other.hdf5")
    del file["episode_1"]
    file["episode_1"] = h5py.ExternalLink("other.hdf5", "episode_1")


def inside(file):
    del file["episode_1/actions"]
    external_link(file["episode_1"], "actions", np.zeros((10, 9)))


def virtually(file):
    group = file["episode_1"]
    del group["actions"]
    virtual(group, "actions", np.zeros((10, 9)))


def objects(file):
    file.create_dataset("episode_1/infos/text", (2**20,), h5py.string_dtype())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("change", [loop, outside, inside, virtually, objects], ids=lambda each: each.__name__)
def test_an_episode_of_minari_is_in_its_file(dataset, tmp_path, monkeypatch, change):
    monkeypatch.chdir(tmp_path)
    with h5py.File(dataset / "main_data.hdf5", "a") as file:
        change(file)
    loaded = minari.load(str(dataset))
    assert minari.load_episode(loaded, 0).actions.shape == (10, 9)
    with pytest.raises(OSError, match="does not hold HDF5"):
        minari.load_episode(loaded, 1)


@pytest.mark.filterwarnings("ignore")
def test_metadata_of_minari_are_bounded(dataset):
    path = dataset / "metadata.json"
    record = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**record, "data_format": "arrow"}), encoding="utf-8")
    with refused(OSError, "in HDF5"):
        minari.load(str(dataset))
    path.write_bytes(b" " * (2**24 + 1))
    with refused(OSError, "bytes of memory"):
        minari.load(str(dataset))

"""Files: who may create one, and damaged contents."""

import errno
import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from helpers.arrays import npy

from kitchen_suite import files


def test_two_writers_of_one_file_never_share_a_temporary_path(tmp_path):
    path = tmp_path / "episode_000000.npz"
    with files.atomic_write(path) as one, files.atomic_write(path) as other:
        assert one != other
        one.write_text("one")
        other.write_text("other")
    assert path.read_text() == "one"
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("links", [True, False])
def test_a_file_is_created_once(tmp_path, monkeypatch, links):
    def refuse(*paths):
        raise OSError(errno.EPERM, "Operation not permitted")

    if not links:
        monkeypatch.setattr(os, "link", refuse)
    path = tmp_path / "recording.json"
    with files.atomic_create(path) as partial:
        partial.write_text("first")
    with pytest.raises(FileExistsError), files.atomic_create(path) as partial:
        partial.write_text("second")
    assert (path.read_text(), os.listdir(tmp_path)) == ("first", [path.name])


def test_an_error_of_a_full_disk_names_the_file(tmp_path):
    with (
        pytest.raises(OSError, match=r"No space left on device: '.*/film.mp4'"),
        files.atomic_write(tmp_path / "film.mp4"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def npz(path, **members):
    """Writes a zip of bytes as they are."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)


def array(values):
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


METADATA = array(np.array(json.dumps({"a": 1})))
BOMBS = {
    "declares more than it holds": npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }"),
    "declares a huge string": npy("{'descr': '<U250000000', 'fortran_order': False, 'shape': (), }"),
    "a negative shape": npy("{'descr': '<f4', 'fortran_order': False, 'shape': (-25,), }"),
    "thousands of brackets": npy("(" * 9000),
    "an open string": npy("{'descr': '<f4"),
    "minus signs": npy("-" * 9000 + "1"),
    "no npy": b"nothing of the kind",
    "objects": npy("{'descr': '|O', 'fortran_order': False, 'shape': (), }", b"\x80\x04N."),
}


@pytest.mark.parametrize("member", BOMBS.values(), ids=BOMBS.keys())
def test_a_member_that_is_no_array_is_refused(tmp_path, member):
    npz(tmp_path / "x.npz", metadata=METADATA, array=member)
    with pytest.raises(OSError, match=r"x.npz does not hold a policy \(\w+(: [^\n]{1,200})?\)$"):
        files.load_arrays(tmp_path / "x.npz", "a policy")
    assert files.load_metadata(tmp_path / "x.npz", "a policy") == {"a": 1}


def test_sizes_are_looked_at_before_arrays_are_read(tmp_path, monkeypatch):
    npz(tmp_path / "x.npz", metadata=METADATA, array=array(np.zeros(2**20)))
    assert tmp_path.joinpath("x.npz").stat().st_size < 20_000
    assert files.load_arrays(tmp_path / "x.npz", "an episode", max_bytes=2**24)[0]["array"].shape == (2**20,)
    monkeypatch.setattr(zipfile.ZipFile, "open", None)
    with pytest.raises(OSError, match=r"x.npz .* 8\d+ bytes of memory"):
        files.load_arrays(tmp_path / "x.npz", "an episode", max_bytes=2**22)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "9" * 5000, '{"a": "\\ud800'])
def test_broken_json_is_refused(tmp_path, text):
    tmp_path.joinpath("x.json").write_text(text)
    with pytest.raises(OSError, match=r"x.json does not hold a specification \(\w+: [^\n]{1,200}\)$"):
        files.load_json(tmp_path / "x.json", "a specification")


DEEP = ["[" * 100_000 + "]" * 100_000, '{"a":' * 100_000 + "0" + "}" * 100_000]


@pytest.mark.parametrize("text", [*DEEP, " " * (2**24 + 1), b"\xff"], ids=["arrays", "objects", "large", "no UTF-8"])
def test_json_of_any_depth_and_size_is_refused_with_a_value_error(text):
    with pytest.raises(ValueError, match=r"^[^\n]{1,200}$"):
        files.parse_json(text)


def test_numbers_and_arrays_of_numpy_become_those_of_python():
    value = {"a": np.float32(0.5), "b": [np.int64(3), np.bool_(True)], "c": (np.arange(2), None)}
    plain = files.json_value(value, "x")
    assert json.dumps(plain) == '{"a": 0.5, "b": [3, true], "c": [[0, 1], null]}'


CYCLE = []
CYCLE.append(CYCLE)


@pytest.mark.parametrize("value", [object(), [{1, 2}], {(1, 2): 3}, b"x", CYCLE, 1j, np.array([object()])])
def test_what_json_cannot_hold_is_refused_by_its_name(value):
    with pytest.raises(TypeError, match=r"^gain must consist of what JSON can hold, got [^\n]{1,200}$"):
        files.json_value(value, "gain")


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_json_cannot_hold_is_refused_by_its_name_and_nothing_is_written(tmp_path, number):
    record = {"scores": [{"low": 0.0}, {"low": number}]}
    message = f"^scores/1/low is {number}, which JSON cannot hold$"
    with pytest.raises(ValueError, match=message), files.atomic_write(tmp_path / "a.json") as partial:
        files.write_json(partial, record)
    with pytest.raises(ValueError, match=message):
        files.save_arrays(tmp_path / "a.npz", {}, record)
    assert not any(tmp_path.iterdir())


def test_a_missing_file_is_named(tmp_path):
    for load in (files.load_json, files.load_arrays):
        with pytest.raises(FileNotFoundError, match=r"^no such file: '.*/x' \(expected an episode\)$"):
            load(tmp_path / "x", "an episode")


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f8", "<f4", "?", "<i8", "<U5"])
def test_arrays_are_read_as_numpy_reads_them(tmp_path, order, dtype):
    values = np.arange(24).reshape(2, 3, 4).astype(dtype, order=order)
    files.save_arrays(tmp_path / "x.npz", {"a/b": values, "empty": np.zeros((0, 3))}, {"seed": 2**70})
    arrays, metadata = files.load_arrays(tmp_path / "x.npz", "an episode")
    with np.load(tmp_path / "x.npz") as expected:
        assert list(arrays) == ["a/b", "empty"]
        for name, found in arrays.items():
            np.testing.assert_array_equal(found, expected[name], strict=True)
    assert metadata == {"seed": 2**70}
    arrays["a/b"][0] = arrays["a/b"][1]


def test_the_reason_of_damaged_contents_is_named(tmp_path):
    tmp_path.joinpath("x.npz").write_bytes(b"nothing")
    with pytest.raises(OSError, match=r"x.npz does not hold an episode \(BadZipFile"):
        files.load_arrays(tmp_path / "x.npz", "an episode")


@pytest.mark.parametrize("load", [files.load_json, files.load_arrays, files.load_metadata])
def test_a_device_or_a_pipe_is_refused_in_place_of_being_read_without_end(tmp_path, load):
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe"):
        with pytest.raises(OSError, match=f"{path} .* not a regular file"):
            load(path, "an episode")


def make_folder(path, text="new", *, interrupt=False):
    with files.atomic_folder(path) as partial:
        partial.mkdir()
        (partial / "file").write_text(text)
        if interrupt:
            raise KeyboardInterrupt


def test_a_folder_is_made_as_a_whole_or_not_at_all(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        make_folder(tmp_path / "made", interrupt=True)
    assert os.listdir(tmp_path) == []
    make_folder(tmp_path / "below" / "made")
    assert [path.read_text() for path in tmp_path.rglob("file")] == ["new"]


def test_a_folder_with_contents_is_never_replaced(tmp_path):
    make_folder(tmp_path / "made", "old")
    with pytest.raises(OSError, match="not empty"):
        make_folder(tmp_path / "made")
    assert (os.listdir(tmp_path), (tmp_path / "made" / "file").read_text()) == (["made"], "old")


NOTES = files.DescribedFolder("notes.json", "a notebook", "page_*")


def test_a_described_folder_is_created_once_and_resumed_by_the_same_description(tmp_path):
    folder, description = tmp_path / "notes", {"title": "one", "pages": 3}
    with pytest.raises(FileNotFoundError, match="does not hold a notebook"):
        NOTES.load(folder)
    NOTES.create(folder, description)
    with pytest.raises(FileExistsError, match="holds a notebook already"):
        NOTES.create(folder, description)
    with pytest.raises(ValueError, match="a notebook with pages 3, not 4"):
        NOTES.resume(folder, NOTES.load(folder), {**description, "pages": 4})
    NOTES.resume(folder, NOTES.load(folder), description)
    assert os.listdir(folder) == ["notes.json"]


def test_contents_without_a_description_are_not_taken_over(tmp_path):
    (tmp_path / "page_1").write_text("x")
    with pytest.raises(FileExistsError, match="holds a notebook already"):
        NOTES.create(tmp_path, {})
    assert os.listdir(tmp_path) == ["page_1"]

"""Differences that the comparison of two trees finds."""

import pickle
import re

import compare_trees
import numpy as np
import pytest
import tree_cases

BEFORE = {
    "info/task_distances": np.arange(3.0),
    "info/names": np.array('["kettle"]'),
    "reward": np.array([0.0, np.nan]),
}
DOCTORED = {
    "one number": {"info/task_distances": np.array([0.0, 1.0, 2.0 + 1e-15])},
    "a sign of zero": {"reward": np.array([-0.0, np.nan])},
    "a type": {"info/task_distances": np.arange(3.0, dtype=np.float32)},
    "a shape": {"reward": np.array([[0.0, np.nan]])},
    "a string": {"info/names": np.array('["microwave"]')},
    "a new key": {"info/extra": np.array(1)},
}


def test_equal_arrays_have_no_differences():
    assert compare_trees.differences(BEFORE, {name: array.copy() for name, array in BEFORE.items()}) == []


@pytest.mark.parametrize("change", DOCTORED)
def test_each_kind_of_change_is_found(change):
    (line,) = compare_trees.differences(BEFORE, {**BEFORE, **DOCTORED[change]})
    assert line.startswith(tuple(DOCTORED[change]))


def test_a_missing_key_is_found():
    assert compare_trees.differences(BEFORE, {"reward": BEFORE["reward"]}) == [
        "info/task_distances: removed",
        "info/names: removed",
    ]


@pytest.mark.parametrize(
    ("errors", "printed"),
    [
        ({"old": {"case": ""}, "new": {"case": ""}}, "all equal"),
        ({"old": {"case": ""}, "new": {}}, "no such case on new"),
        ({"old": {"case": ""}, "new": {"case": "ValueError: no"}}, "ValueError: no"),
        ({"old": {}, "new": {}}, "0 cases"),
    ],
)
def test_cases_that_one_tree_cannot_play_are_different(errors, printed, tmp_path, capsys):
    folders = {name: tmp_path / name for name in errors}
    for folder in folders.values():
        folder.mkdir()
        (folder / compare_trees.file_name("case")).write_bytes(pickle.dumps(BEFORE))
    assert compare_trees.compare(folders, errors) == (printed == "all equal")
    assert printed in capsys.readouterr().out


def test_nested_results_are_arrays_by_path():
    nested = {"a": [np.ones(2), None], "names": ["kettle", "microwave"], "none": {}, "large": 2**70}
    arrays = tree_cases.flat("info", nested)
    assert {name: array.tolist() for name, array in arrays.items()} == {
        "info/a/0": [1.0, 1.0],
        "info/a/1": "null",
        "info/names": '["kettle", "microwave"]',
        "info/none/empty": True,
        "info/large": str(2**70),
    }


def test_rows_in_which_a_key_stands_are_kept():
    rows = [{"a": np.array(1.0), "b": np.zeros(2)}, {"a": np.array(2.0)}, {"a": np.array(3.0), "b": np.zeros(3)}]
    arrays = tree_cases.stacked(rows)
    assert list(arrays) == ["a", "b@0", "b@2", "b@rows"]
    assert arrays["b@rows"].tolist() == [0, 2]


def test_quick_cases_touch_every_kind(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    names = list(tree_cases.cases.__wrapped__())
    # Cases of training need the extra `train`.
    played = [
        each for each in compare_trees.QUICK if not each.startswith("train") or tree_cases.has("torch", "tensorboard")
    ]
    for expression in played:
        assert any(re.search(expression, name) for name in names), expression

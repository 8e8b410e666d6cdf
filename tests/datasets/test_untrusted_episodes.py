"""Episodes whose arrays are not those of their task: refused where they are read, in one line."""

import dataclasses
import itertools
import json
import shutil

import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.errors import assert_is_short
from helpers.sweeps import brief

from kitchen_suite.commands import convert, evaluate, record
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.recording import Recording

KEY = "observation/observation"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "runs"
    arguments = ["--num_threads=1", "--max_episode_steps=3", f"--output={folder}", "--num_episodes=1"]
    assert record.main([*arguments, "--task_name=random_4"]) == 0
    return folder


def arrays_of(change):
    """The arrays of a change, by name; None takes an array away."""

    def apply(arrays):
        changed = {**arrays, **change(arrays)}
        return {name: array for name, array in changed.items() if array is not None}

    return apply


# Changes of structure, which no reader takes.
MISSHAPEN = {
    "an array and a group": lambda a: {f"{KEY}/more": a[KEY]},
    "deep": lambda a: {"observation/" + "a/" * 50 + "b": a[KEY]},
    "an empty key": lambda a: {"observation//a": a[KEY]},
    "one dimension": lambda a: {"observation/x": a[KEY][:, 0]},
    "no dimension": lambda a: {"observation/x": np.array(1.0)},
    "rows": lambda a: {KEY: a[KEY][:-1]},
    "texts": lambda a: {KEY: a[KEY].astype("U8")},
    "times": lambda a: {KEY: a[KEY].astype("M8[s]")},
    "complex": lambda a: {KEY: a[KEY] + 1j},
    "no observations": lambda a: dict.fromkeys(name for name in a if name.startswith("observation")),
    "no actions": lambda a: {"action": None},
    "rewards of two dimensions": lambda a: {"reward": a["reward"][:, np.newaxis]},
}

# Changes against the spaces of the environment, which nobody computes with.
OTHERS = {
    "58 numbers for 59": lambda a: {KEY: a[KEY][:, :-1]},
    "60 numbers": lambda a: {KEY: np.concatenate([a[KEY], a[KEY][:, :1]], axis=1)},
    "integers": lambda a: {KEY: a[KEY].astype(np.int64)},
    "another axis": lambda a: {KEY: a[KEY][..., np.newaxis]},
    "1e300": lambda a: {KEY: np.where(np.arange(59) == 7, 1e300, a[KEY])},
    "NaN": lambda a: {KEY: np.where(np.arange(59) == 7, np.nan, a[KEY])},
    "infinite": lambda a: {KEY: np.where(np.arange(59) == 7, np.inf, a[KEY])},
    "another observation": lambda a: {"observation/more": a[KEY]},
    "one that is missing": lambda a: {KEY: None},
    "8 numbers of an action": lambda a: {"action": a["action"][:, :-1]},
}


@pytest.fixture
def forge(runs, tmp_path):
    """Returns a copy of the recording whose episode has other arrays, with the digest of its actions made anew."""

    def forge(change):
        folder = tmp_path / "forged"
        shutil.copytree(runs, folder)
        path = folder / "episode_000000.npz"
        metadata, arrays = load_episode(path)
        changed = arrays_of(change)(arrays)
        if "action" in changed:
            changed_episode = Episode(index=0, seed=0, arrays=changed)
            metadata["actions_sha256"] = changed_episode.actions_sha256
        np.savez_compressed(path, **changed, metadata=json.dumps(metadata))
        return folder

    return forge


READERS = {
    "convert": lambda folder: convert.main(
        [str(folder), "--format=ogbench", "--dataset=me/x", f"--data_path={folder.parent / 'data'}"]
    ),
    "evaluate": lambda folder: evaluate.main(
        ["--policy=zero", "--protocol=beso", f"--dataset={folder}", "--num_episodes=1", "--max_episode_steps=3"]
    ),
}


@pytest.mark.full
@pytest.mark.parametrize("kind", MISSHAPEN)
def test_an_episode_that_could_not_be_read_is_not_written(runs, tmp_path, kind):
    recording = Recording.open(runs)
    episode = recording.load(0)
    other = Recording.create(tmp_path / "other", recording.spec)
    with pytest.raises(ValueError, match="episode 0 cannot be recorded") as raised:
        other.append(dataclasses.replace(episode, arrays=arrays_of(MISSHAPEN[kind])(episode.arrays)))
    assert_is_short(str(raised.value))
    assert other.indices == []
    other.append(episode)
    assert other.load(0).digest == episode.digest


@pytest.mark.full
@pytest.mark.parametrize("kind", MISSHAPEN)
def test_misshapen_arrays_are_no_episode(forge, kind):
    folder = forge(MISSHAPEN[kind])
    with pytest.raises(OSError, match="does not hold an episode") as raised:
        Recording.open(folder).load(0)
    assert_is_short(str(raised.value))


# Every reader asks one function, of which `convert` sees all cases.
SOME = ("1e300", "8 numbers of an action")


@pytest.mark.full
@pytest.mark.parametrize(
    ("reader", "kind"),
    brief(
        itertools.product(READERS, OTHERS),
        [("convert", kind) for kind in OTHERS] + [("evaluate", kind) for kind in SOME],
    ),
)
def test_arrays_of_other_spaces_are_not_computed_with(forge, capsys, reader, kind):
    folder = forge(OTHERS[kind])
    assert READERS[reader](folder) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "does not hold an episode of its task" in err


@pytest.mark.clients
@pytest.mark.parametrize("kind", brief(OTHERS, SOME))
def test_nothing_is_learned_of_arrays_of_other_spaces(forge, kind):
    from kitchen_suite.training.demonstrations import load_to_clone

    folder = forge(OTHERS[kind])
    with pytest.raises(OSError, match="does not hold an episode of its task"):
        load_to_clone(folder, Recording.open(folder).spec)

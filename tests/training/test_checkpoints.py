"""Checkpoints of a seed: written whole, loaded unchanged, and those of version 1.0 too."""

import hashlib

import numpy as np
import pytest
from helpers.errors import refused
from helpers.training import BATCH, assert_same_state, environments, learner

pytestmark = pytest.mark.clients


@pytest.fixture(scope="module")
def state():
    """The state of a learner that has learned from a batch, as in a checkpoint."""
    envs = environments(4)
    taught = learner(envs)
    taught.start(0)
    taught.learn()
    yield {**taught.state(), "seconds": 1.5, "best": (0.0, 1.25), "successes": [0.0]}
    envs.close()


def test_a_saved_checkpoint_is_loaded_unchanged(state, tmp_path):
    from kitchen_suite.training.run import load_checkpoint, save_checkpoint

    assert load_checkpoint(tmp_path) is None
    assert save_checkpoint(tmp_path, state).name == f"checkpoint_{BATCH:012d}.pt"
    assert_same_state(load_checkpoint(tmp_path), state)


def test_a_checkpoint_of_version_1_0_is_loaded_which_ended_with_its_digest(state, tmp_path):
    from kitchen_suite.training.run import load_checkpoint, save_checkpoint

    path = save_checkpoint(tmp_path, state)
    contents = path.read_bytes()
    path.write_bytes(contents + hashlib.sha256(contents).digest())
    assert_same_state(load_checkpoint(tmp_path), state)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_checkpoint_that_cannot_be_read_is_named(state, tmp_path, share):
    from kitchen_suite.training.run import load_checkpoint, save_checkpoint

    save_checkpoint(tmp_path, {**state, "steps": 1})
    path = save_checkpoint(tmp_path, state)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with refused(OSError, str(path), "the run is resumed from the one before"):
        load_checkpoint(tmp_path)
    path.unlink()
    assert load_checkpoint(tmp_path)["steps"] == 1


def test_a_checkpoint_that_names_code_runs_none(tmp_path):
    from kitchen_suite.training.run import load_checkpoint

    path = tmp_path / "checkpoint_000000000001.pt"
    path.write_bytes(b"\x80\x04cos\nsystem\n(S'touch ran'\ntR.")
    with refused(OSError, str(path)):
        load_checkpoint(tmp_path)
    assert not (tmp_path / "ran").exists()


def test_the_last_checkpoints_are_kept(state, tmp_path):
    from kitchen_suite.training.run import save_checkpoint

    for steps in np.arange(5).tolist():
        save_checkpoint(tmp_path, {**state, "steps": steps})
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"checkpoint_{i:012d}.pt" for i in (2, 3, 4)]

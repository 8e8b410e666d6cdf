"""Damaged checkpoints and files of another kind: refused, or read as what was saved."""

import dataclasses
import hashlib
import io
import re

import numpy as np
import pytest
from helpers.training import BATCH, assert_same_state, environments, learner

pytestmark = pytest.mark.clients


@pytest.fixture(scope="module")
def training_environments():
    envs = environments(4)
    yield envs
    envs.close()


@pytest.fixture(scope="module")
def taught(training_environments):
    """A learner that has learned from a batch."""
    taught = learner(training_environments)
    taught.start(0)
    taught.learn()
    return taught


def checkpoint_of(taught, **changes):
    from kitchen_suite.training.checkpoints import Checkpoint

    progress = {"seconds": 1.5, "processor_seconds": 2.5, "best": (0.0, 1.25), "progress": 0.5, "successes": [0.0]}
    return Checkpoint(**{**taught.state(), **progress, **changes})


@pytest.fixture
def saved(taught, tmp_path):
    """The file of a checkpoint."""
    from kitchen_suite.training import checkpoints

    return checkpoints.save(tmp_path, checkpoint_of(taught))


def write(path, contents):
    """Writes a checkpoint of any contents, with their digest."""
    path.write_bytes(contents + hashlib.sha256(contents).digest())


def encoded(state):
    """Returns a state as PyTorch writes it."""
    import torch

    contents = io.BytesIO()
    torch.save(state, contents)
    return contents.getvalue()


def positions(size, count, generator):
    """Bytes anywhere in a file, and as many of the pickle at its start, and of zip directory and digest at its end."""
    return generator.integers((0, 0, size - 4000), (size, 4000, size), (count, 3)).ravel()


def test_no_flipped_bit_of_a_checkpoint_is_read_as_another_state(saved, capsys):
    from kitchen_suite.training import checkpoints

    contents, generator = saved.read_bytes(), np.random.default_rng(0)
    for position in positions(len(contents), 500, generator):
        damaged = bytearray(contents)
        damaged[position] ^= 1 << generator.integers(8)
        saved.write_bytes(damaged)
        with pytest.raises(checkpoints.CheckpointError, match=rf"{saved} does not hold a checkpoint"):
            checkpoints.load_last(saved.parent)
    assert capsys.readouterr() == ("", "")


def test_a_checkpoint_of_an_earlier_version_is_refused_in_one_sentence(saved):
    from kitchen_suite.training import checkpoints

    saved.write_bytes(saved.read_bytes()[:-32])
    with pytest.raises(checkpoints.CheckpointError, match=rf"{saved} .*earlier version\)$"):
        checkpoints.load_last(saved.parent)


@pytest.mark.parametrize("content", [[], {}, None, 5, {"steps": 1}, "text"], ids=str)
def test_a_readable_file_of_another_kind_leads_to_the_checkpoint_before_it(saved, taught, content, capsys):
    from kitchen_suite.training import checkpoints

    newest = saved.with_name("checkpoint_999999999999.pt")
    write(newest, encoded(content))
    assert checkpoints.load_last(saved.parent, taught.check_fits).steps == BATCH
    expected = rf"{newest} does not hold a checkpoint \(.+\); trying the checkpoint before it\n"
    assert re.fullmatch(expected, capsys.readouterr().out)


def without(part):
    def change(state):
        del state["modules"][part]

    return change


def transposed(state):
    weights = state["modules"]["policy"]
    weights["network.0.weight"] = weights["network.0.weight"].T


def without_moments(state):
    del state["modules"]["optimizer"]["state"][0]["exp_avg"]


def of_another_parameter(state):
    state["modules"]["optimizer"]["state"][99] = state["modules"]["optimizer"]["state"].pop(0)


def with_other_groups(state):
    state["modules"]["optimizer"]["param_groups"].pop()


CHANGES = {
    "no scaler": without("observation_scaler"),
    "no optimizer": without("optimizer"),
    "a transposed weight": transposed,
    "no moments": without_moments,
    "moments of another parameter": of_another_parameter,
    "other parameter groups": with_other_groups,
    "a bad random state": lambda state: state.update(random=state["random"][:100]),
    "negative steps": lambda state: state.update(steps=-1),
    "steps of another type": lambda state: state.update(steps="many"),
    "too many evaluations": lambda state: state.update(successes=[0.0] * 3),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_checkpoint_that_does_not_fit_the_learner_is_refused(saved, taught, change):
    import torch

    from kitchen_suite.training import checkpoints

    state = torch.load(saved, weights_only=True)
    CHANGES[change](state)
    write(saved, encoded(state))
    with pytest.raises(checkpoints.CheckpointError, match="none of the 1 checkpoints"):
        checkpoints.load_last(saved.parent, taught.check_fits)


def test_a_checkpoint_of_other_networks_is_refused(saved, training_environments):
    from kitchen_suite.training import checkpoints

    other = learner(training_environments, hidden=[9])
    before = other.state()
    with pytest.raises(checkpoints.CheckpointError):
        checkpoints.load_last(saved.parent, other.check_fits)
    assert_same_state(other.state(), before)


def test_a_saved_checkpoint_is_loaded_unchanged(saved, taught):
    from kitchen_suite.training import checkpoints

    checkpoint = checkpoint_of(taught)
    found = checkpoints.load_last(saved.parent, taught.check_fits)
    assert_same_state(vars(found), vars(checkpoint))
    assert [field.name for field in dataclasses.fields(checkpoint)] == [*vars(found)]


def test_a_checkpoint_larger_in_memory_than_in_its_file_is_refused(saved, taught):
    import zipfile

    from kitchen_suite.training import checkpoints

    with zipfile.ZipFile(io.BytesIO(saved.read_bytes())) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    largest = max(members, key=lambda name: len(members[name]))
    members[largest] = bytes(2**24)
    contents = io.BytesIO()
    with zipfile.ZipFile(contents, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    write(saved, contents.getvalue())
    with pytest.raises(checkpoints.CheckpointError):
        checkpoints.load_last(saved.parent, taught.check_fits)


def test_nothing_in_the_reasons_advises_to_run_code_of_a_file(saved, taught, capsys):
    from kitchen_suite.training import checkpoints

    write(saved, b"\x80\x04cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(checkpoints.CheckpointError) as raised:
        checkpoints.load_last(saved.parent, taught.check_fits)
    assert not re.search("weights_only", str(raised.value) + capsys.readouterr().out)

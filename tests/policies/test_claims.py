"""A policy that cannot act leaves no folder; addresses of policies leave no password; seeds of NumPy's integers."""

import sys
import types

import gymnasium
import numpy as np
import pytest

from kitchen_suite.commands import evaluate, record, rollout
from kitchen_suite.policies import PolicyRef

pytestmark = pytest.mark.usefixtures("folder")

ENDS = ["--max_episode_steps=3", "--num_episodes=1", "--output=runs"]
COMMANDS = {"record": record, "rollout": rollout, "evaluate": evaluate}


@pytest.fixture
def failing(monkeypatch):
    """A policy whose first action is none."""
    module = types.ModuleType("failing")
    module.act = lambda timestep: np.full(9, np.nan)
    monkeypatch.setitem(sys.modules, "failing", module)
    return "--policy=failing:act"


@pytest.mark.full
@pytest.mark.parametrize("name", COMMANDS)
def test_a_policy_that_cannot_act_leaves_no_folder(run, folder, failing, name):
    status, _, err = run(COMMANDS[name], failing, *ENDS)
    assert (status, err.count("\n")) == (2, 1)
    assert not [*folder.iterdir()]
    # So that the same command, with a policy that can, finds the folder free.
    assert run(COMMANDS[name], "--policy=zero", *ENDS)[0] == 0


@pytest.mark.full
@pytest.mark.parametrize("name", COMMANDS)
def test_zeros_are_refused_where_they_are_no_action(run, folder, name):
    status, _, err = run(COMMANDS[name], "--policy=zero", "--control_mode=ee_pose", *ENDS)
    assert (status, err.count("\n")) == (2, 1)
    assert "'zero'" in err
    assert not [*folder.iterdir()]


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("ws://me:secret@localhost:8000/a@b", "ws://localhost:8000/a@b"),
        ("wss://me@host:1", "wss://host:1"),
        ("remote(address='ws://me:secret@host:1', timeout=3)", "remote(address='ws://host:1', timeout=3)"),
        ("ws://localhost:8000", "ws://localhost:8000"),
    ],
)
def test_results_keep_no_password(text, kept):
    reference = PolicyRef.parse(text)
    assert reference.text == kept
    assert reference.without_file == kept
    assert "me" not in kept or "secret" not in reference.text
    assert reference.options["address"] in text


@pytest.mark.full
@pytest.mark.parametrize("seed", [np.int8(3), np.uint64(3), np.int32(3), 3])
def test_seeds_may_be_integers_of_numpy(seed):
    single = gymnasium.make("KitchenSuite/FrankaMicrowaveTable-v1")
    many = gymnasium.make_vec("KitchenSuite/FrankaMicrowaveTable-v1", 1, vectorization_mode="vector_entry_point")
    observation, _ = single.reset(seed=seed)
    np.testing.assert_array_equal(observation, single.reset(seed=3)[0])
    np.testing.assert_array_equal(observation, many.reset(seed=seed)[0][0])

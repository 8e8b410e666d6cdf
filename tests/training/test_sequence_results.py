"""docs/sequence_results.py trains a network on sequences, and evaluates it beside that for one task at a time."""

import importlib
import json
import subprocess

import pytest

pytestmark = pytest.mark.clients

SMALL = {
    "num_envs": 2,
    "rollouts": 16,
    "hidden": [256, 128],
    "mini_batches": 2,
    "learning_epochs": 1,
    "value_batches": 1,
}


@pytest.fixture
def script(tmp_path, monkeypatch):
    script = importlib.import_module("sequence_results")
    shorter = ("--num_steps=128", "--eval_interval=64", "--eval_episodes=2", f"--hyperparameters={json.dumps(SMALL)}")
    monkeypatch.setattr(script, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(script, "EPISODES", 2)
    monkeypatch.setattr(script, "TRAINING", (*script.TRAINING, *shorter))
    return script


def test_both_networks_are_evaluated_in_sequences_and_only_once(script, tmp_path, monkeypatch):
    assert script.main([str(tmp_path / "runs")]) == 0
    results = {path.stem: json.loads(path.read_text("utf-8")) for path in script.RESULTS.iterdir()}
    assert sorted(results) == ["sequences_4", "sequences_7", "single_4", "single_7"]
    for name, result in results.items():
        assert result["num_episodes"] == 2
        assert result["task_kwargs"]["tasks_in_turn"] is True
        length = int(name[-1])
        assert f"p{length}" in result
        assert f"p{length + 1}" not in result
    # The network for one task at a time completes the first task that is asked.
    assert results["single_4"]["p1"] == results["single_7"]["p1"] == 1.0
    digests = {name: result["policy_sha256"] for name, result in results.items()}
    assert digests["single_4"] == digests["single_7"] != digests["sequences_4"] == digests["sequences_7"]

    # A second run trains no further, and evaluates nothing again.
    commands = []
    monkeypatch.setattr(subprocess, "run", lambda command, check: commands.append(command))
    assert script.main([str(tmp_path / "runs")]) == 0
    (command,) = commands
    assert command[-1] == "--resume"


def test_no_folder_prints_the_usage(script, capsys):
    assert script.main([]) == 2
    assert "docs/sequence_results.py FOLDER" in capsys.readouterr().err

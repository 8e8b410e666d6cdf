"""The experiment on offline learning records, trains and evaluates what is missing."""

import json

import pytest
from docs_scripts import load_script

from kitchen_suite.commands import replay

pytestmark = pytest.mark.clients

SMALL_PPO = {"num_envs": 2, "rollouts": 4, "mini_batches": 2, "hidden": [8], "clone_epochs": 1, "value_batches": 1}


@pytest.fixture
def offline(tmp_path, monkeypatch):
    module = load_script("experiments/offline")
    for name, file in (("RESULTS", "offline"), ("SETS", "datasets.json"), ("ONLINE", "online.json")):
        monkeypatch.setattr(module, name, tmp_path / "results" / file)
    (tmp_path / "results").mkdir()
    monkeypatch.setattr(module, "EPISODES", 2)
    monkeypatch.setattr(module, "STEPS", 20)
    monkeypatch.setattr(module, "ONLINE_STEPS", 10)
    call = module.call

    def short(command, *flags):
        """Calls a command with fewer and shorter episodes, and small networks."""
        if command == "record":
            preset = next(flag for flag in flags if flag.startswith("--preset"))
            flags = (*flags, "--num_episodes=3" if preset == "--preset=mixed" else "--num_episodes=1")
        if command == "train":
            assert "--num_threads=1" in flags
            flags = tuple(flag for flag in flags if flag != "--eval_episodes=10")
            flags = (*flags, "--eval_episodes=1", f"--hyperparameters={json.dumps(SMALL_PPO)}")
        return call(command, *flags)

    run_baseline = module.run_baseline

    def small(name, recording, output, *flags):
        return run_baseline(name, recording, output, *flags, "--width=8", "--batch_size=16", "--candidates=4")

    monkeypatch.setattr(module, "call", short)
    monkeypatch.setattr(module, "run_baseline", small)
    return module


@pytest.mark.parametrize("algorithm", ["iql", "idql"])
def test_a_baseline_is_trained_and_measured_once(offline, tmp_path, monkeypatch, algorithm):
    folder = tmp_path / "work"
    assert offline.main([str(folder), f"{algorithm}:mixed:2"]) == 0
    result = json.loads((tmp_path / "results" / "offline" / f"{algorithm}_mixed_2.json").read_text())
    assert (result["algorithm"], result["preset"], result["seed"]) == (algorithm, "mixed", 2)
    condition = result["conditions"]["mixed"]
    assert condition["num_episodes"] == 2
    assert len(condition["digest"]) == 64
    assert 0.0 <= condition["success"] <= 1.0
    assert result["minutes"] > 0
    assert replay.main([str(folder / f"{algorithm}_mixed_2" / "receipt.npz")]) == 0
    monkeypatch.setattr(offline, "call", lambda *arguments: pytest.fail("it ran again"))
    assert offline.main([str(folder), f"{algorithm}:mixed:2"]) == 0
    tables = load_script("scripts/result_tables")
    monkeypatch.setattr(tables, "RESULTS", tmp_path / "results")
    row = next(line for line in tables.offline_table().splitlines() if f"`{algorithm}`" in line)
    assert row.split("|")[1].strip() == "`mixed`"


def test_what_ppo_makes_of_a_clone_is_measured_beside_it(offline, tmp_path, monkeypatch):
    monkeypatch.setattr(offline, "SEEDS", (1,))
    assert offline.main([str(tmp_path / "work"), "online"]) == 0
    (row,) = json.loads((tmp_path / "results" / "online.json").read_text())
    assert row["seed"] == 1
    assert (row["clone"]["steps"], row["online"]["steps"]) == (0, 10)
    assert row["clone"]["digest"] != row["online"]["digest"]
    monkeypatch.setattr(offline, "call", lambda *arguments: pytest.fail("it ran again"))
    assert offline.main([str(tmp_path / "work"), "online"]) == 0


def test_sets_are_described_and_kept(offline, tmp_path, monkeypatch):
    monkeypatch.setattr(offline, "RECORDED", (("mixed", ""), ("complete", "start")))
    assert offline.main([str(tmp_path / "work"), "sets"]) == 0
    result = json.loads((tmp_path / "results" / "datasets.json").read_text())
    first, second = result["sets"]
    assert (first["preset"], first["episodes"], first["steps"], first["successes"]) == ("mixed", 3, 420, 0)
    assert sum(first["tasks_completed"].values()) == 3
    assert (second["preset"], second["variations"], second["successes"]) == ("complete", "start", 1)
    assert len(first["digest"]) == len(second["digest"]) == 64
    monkeypatch.setattr(offline, "call", lambda *arguments: pytest.fail("it ran again"))
    assert offline.main([str(tmp_path / "work"), "sets"]) == 0


def test_scores_are_shares_of_the_tasks_asked_for():
    tables = load_script("scripts/result_tables")
    assert tables._offline_score({"task_name": "mixed", "mean_tasks": 3.0}) == 75.0
    assert tables._over_seeds([50.0, 60.0, 70.0]) == "60 (35 to 85)"

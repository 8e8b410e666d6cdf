"""docs/training_results.py trains and measures the tasks of the page on training."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from docs_blocks import blocks_of, run

pytestmark = pytest.mark.clients

PAGE = Path(__file__).resolve().parents[2] / "docs" / "training_results.py"
SMALL = {"num_envs": 4, "rollouts": 16, "hidden": [8], "mini_batches": 2, "learning_epochs": 2}
FLAGS = ("--num_steps=128", "--eval_interval=64", "--eval_episodes=2", f"--hyperparameters={json.dumps(SMALL)}")


@pytest.fixture
def results(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("docs_training_results", PAGE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "RESULTS", tmp_path / "training.json")
    monkeypatch.setattr(module, "EPISODES", 2)
    monkeypatch.setattr(module, "FLAGS", dict.fromkeys(module.SEEDS, FLAGS))
    return module


def test_a_run_is_trained_and_measured_once(results, tmp_path, monkeypatch):
    assert results.main([str(tmp_path), "kettle:2"]) == 0
    (row,) = results.read()
    assert (row["task"], row["seed"], row["steps"], row["episodes"]) == ("kettle", 2, 128, 2)
    assert 0 < row["minutes"] < 10
    assert 0 < row["processor_minutes"] < 10
    assert row["success"] in ([0], [1], [2])
    monkeypatch.setattr(results.subprocess, "run", lambda *arguments, **options: pytest.fail("it ran again"))
    assert results.main([str(tmp_path), "kettle:2"]) == 0


def test_an_interrupted_run_is_resumed(results, tmp_path):
    assert "--resume" not in results.command(("kettle", 1), tmp_path)
    (tmp_path / "kettle_1").mkdir()
    (tmp_path / "kettle_1" / "training.json").write_text("{}")
    assert results.command(("kettle", 1), tmp_path)[-1] == "--resume"


def test_groups_name_their_runs_in_order(results):
    assert results.runs_of(["drawer"]) == [("top_drawer", seed) for seed in (1, 2, 3, 4, 5)]
    assert len(results.runs_of(["kitchen"])) == 21
    assert results.runs_of(["kettle:3", "microwave:1"]) == [("kettle", 3), ("microwave", 1)]


def test_rows_are_kept_in_the_order_of_tasks_and_seeds(results):
    for task, seed in (("kettle", 2), ("top_drawer", 1), ("kettle", 1), ("kettle", 2)):
        results.add({"task": task, "seed": seed})
    assert [(row["task"], row["seed"]) for row in results.read()] == [("top_drawer", 1), ("kettle", 1), ("kettle", 2)]


@pytest.mark.parametrize("arguments", [[], ["runs", "kettl:1"], ["runs", "kettle"], ["runs", "kettle:one"]])
def test_bad_arguments_print_the_usage(results, capsys, arguments):
    assert results.main(arguments) == 2
    assert "docs/training_results.py FOLDER" in capsys.readouterr().err


def test_one_network_is_measured_with_each_of_the_tasks_asked(results, tmp_path, monkeypatch):
    from kitchen_suite.training import evaluation

    asked = []

    def evaluate(policy, environments, seeds):
        infos = environments.reset(seed=list(seeds))[1]
        asked.append(infos["requested_tasks_mask"])
        return {"episode/success": np.ones(len(seeds))}

    monkeypatch.setattr(evaluation, "evaluate", evaluate)
    assert results.main([str(tmp_path), "random_1:1"]) == 0
    (row,) = results.read()
    assert row["success"] == [2] * 7
    np.testing.assert_array_equal(np.array(asked), np.repeat(np.eye(7, dtype=bool)[:, np.newaxis], 2, axis=1))


def test_the_speed_of_training_is_measured_with_its_parts(tmp_path, monkeypatch):
    path = PAGE.with_name("training_speed.py")
    spec = importlib.util.spec_from_file_location("docs_training_speed", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "RESULTS", tmp_path / "speed.json")
    monkeypatch.setattr(module, "SETTINGS", {"small": SMALL})
    monkeypatch.setattr(module, "STEPS", 128)
    module.main("1")
    rows = json.loads(module.RESULTS.read_text())
    assert [(row["settings"], row["threads"]) for row in rows] == [("small", 1), ("small", 2)]
    for row in rows:
        assert row["steps_per_second"] > 0
        assert 0 < row["environments"] < 1
        assert 0 < row["update"] < 1 - row["environments"]


def test_the_policies_with_the_most_successes_are_shipped(results, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "SHIPPED", tmp_path / "shipped")
    results.SHIPPED.mkdir()
    for seed, success in ((1, 97), (2, 99), (3, 99)):
        results.add({"task": "kettle", "seed": seed, "success": [success]})
        (tmp_path / f"kettle_{seed}").mkdir()
        (tmp_path / f"kettle_{seed}" / "policy.npz").write_text(f"{seed}")
    for seed, success in ((1, [99, 100, 90]), (2, [97, 97, 97])):
        results.add({"task": "random_1", "seed": seed, "success": success})
        (tmp_path / f"random_1_{seed}").mkdir()
        (tmp_path / f"random_1_{seed}" / "policy.npz").write_text(f"seven {seed}")
    results.add({"task": "top_drawer", "seed": 1, "success": [100]})
    assert results.main([str(tmp_path), "ship"]) == 0
    shipped = {path.name: path.read_text() for path in results.SHIPPED.iterdir()}
    assert shipped == {"kettle.npz": "2", "seven_in_turn.npz": "seven 2"}


def test_the_page_has_the_flags_of_the_one_network(tmp_path):
    script = importlib.import_module("training_results")
    task = f"--task_name={script.ONE} --output"
    (block,) = (block for block in blocks_of(PAGE.with_name("training.md")) if task in block.code)
    program = tmp_path / "programs" / "kitchen-train"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    program.chmod(0o755)
    shown, used = _values(run(block, tmp_path, program.parent).splitlines()), _values(script.FLAGS[script.ONE])
    for name in ("--domain_name", "--task_name", "--output"):
        del shown[name]
    # The page sets no limit.
    del used["--num_steps"]
    assert shown == used


def _values(flags):
    """Returns flags by name; those with JSON are decoded."""
    pairs = (flag.split("=", 1) for flag in flags)
    return {name: json.loads(value) if value[0] == "{" else value for name, value in pairs}
